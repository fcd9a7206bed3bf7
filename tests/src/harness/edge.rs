//! Simulated ends of the rows' edges.

use alight_shared::bus::{Bus, Edge, Ports as _, Wired};

/// An edge of two closures: one adds to the row's input; the other removes from the row's output, before it reaches the
/// bus, what leaves the computer.
struct Ends<R, W>(R, W);

impl<N: Wired, R: FnMut(&mut N::In), W: FnMut(&N::In, &mut N::Out)> Edge<N> for Ends<R, W> {
    fn read(&mut self, input: &mut N::In) {
        (self.0)(input);
    }
    fn write<B: Bus>(&mut self, input: &N::In, out: &mut N::Out, ports: &mut N::Ports<B>) -> bool {
        (self.1)(input, out);
        ports.write(out)
    }
}

/// Edge of a row of `N` with these two closures.
pub(super) fn edge<N: Wired>(
    read: impl FnMut(&mut N::In),
    write: impl FnMut(&N::In, &mut N::Out),
) -> impl Edge<N> {
    Ends(read, write)
}
