//! The simulated ends of rows' edges.

use alight_shared::bus::{Bus, Edge, Ports as _, Wired};

/// An edge of two closures: it adds to an input, and takes from an output what goes outside before the bus has it.
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

/// The edge of a row of `N` that reads and writes so.
pub(super) fn edge<N: Wired>(
    read: impl FnMut(&mut N::In),
    write: impl FnMut(&N::In, &mut N::Out),
) -> impl Edge<N> {
    Ends(read, write)
}
