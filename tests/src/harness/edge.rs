use alight_shared::bus::{Bus, Edge, Ports as _, Wired};

/// Edge made of two closures: the first adds to the row's input; the second takes data that leaves the
/// computer out of the row's output before the output reaches the bus.
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

pub(super) fn edge<N: Wired>(
    read: impl FnMut(&mut N::In),
    write: impl FnMut(&N::In, &mut N::Out),
) -> impl Edge<N> {
    Ends(read, write)
}
