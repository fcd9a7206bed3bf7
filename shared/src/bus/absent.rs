//! Optional bus: a row without a bus has neither readers nor writers.

use super::{Bus, Reader, Wake, Writer};
use crate::{plain::Plain, process::InputState};

impl<B: Bus> Bus for Option<B> {
    type Error = B::Error;
    type Reader<M: Plain> = Option<B::Reader<M>>;
    type Writer<M: Plain> = Option<B::Writer<M>>;
    type Wake = Option<B::Wake>;

    fn reader<M: Plain>(&self) -> Result<Self::Reader<M>, B::Error> {
        self.as_ref().map(B::reader).transpose()
    }
    fn writer<M: Plain>(&self) -> Result<Self::Writer<M>, B::Error> {
        self.as_ref().map(B::writer).transpose()
    }
    fn wake<M: Plain>(&self) -> Result<Self::Wake, B::Error> {
        self.as_ref().map(B::wake::<M>).transpose()
    }
}
impl<M, R: Reader<M>> Reader<M> for Option<R> {
    fn read_newest(&mut self, now_ns: i64, to: &mut Option<M>) {
        *to = None;
        if let Some(reader) = self {
            reader.read_newest(now_ns, to);
        }
    }
    fn read_all(&mut self, now_ns: i64, to: &mut Vec<M>) {
        to.clear();
        if let Some(reader) = self {
            reader.read_all(now_ns, to);
        }
    }
    fn state(&self, now_ns: i64) -> InputState {
        self.as_ref()
            .map_or_else(InputState::default, |r| r.state(now_ns))
    }
}
impl<W: Wake> Wake for Option<W> {
    fn woke(&mut self) -> bool {
        self.as_mut().is_some_and(W::woke)
    }
}
impl<M, W: Writer<M>> Writer<M> for Option<W> {
    fn send(&mut self, message: &M) {
        if let Some(w) = self {
            w.send(message);
        }
    }
    fn unsent(&self) -> u64 {
        self.as_ref().map_or(0, W::unsent)
    }
}
