//! The file: an MCAP that a thread of its own writes, so that the flight does not wait for it. It is
//! not compressed: LZ4 halves the file and doubles the processor time that recording costs.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, ErrorKind};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions, Writer};

/// A batch goes to the thread when it holds this many bytes.
const BATCH_BYTES: usize = 256 << 10;
/// Batches under way at most; then the flight waits for the disk.
const BATCHES: usize = 8;
/// A chunk of the file.
const CHUNK_BYTES: u64 = 1 << 20;

/// Bytes per write to the disk.
const BUFFER_BYTES: usize = 1 << 20;

/// A channel of the file, or of those who look on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Channel(pub u16);

/// Opens channels of protobuf messages: in a file, or to viewers.
pub trait OpenChannels {
    /// A channel; `schema` is its name and its file descriptor set.
    fn protobuf(&mut self, topic: &str, schema: (&str, &[u8])) -> Result<Channel, McapError>;
}

/// Takes messages: into a file, or to viewers.
pub trait TakeMessages {
    /// A message of time `t_ns`, encoded by `encode` to the end of what it is given.
    fn message<E>(
        &mut self,
        channel: Channel,
        t_ns: u64,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E>;
}

impl Channel {
    /// Its number in the file.
    pub fn id(self) -> u16 {
        self.0
    }
}

/// What a person reads of an error: the system's own words, where it has some.
pub fn why(error: &McapError) -> String {
    match error {
        McapError::Io(e) => e.to_string(),
        other => other.to_string(),
    }
}

/// The same of a file that could not be written, with what to do.
pub fn unwritable(path: &Path, error: &McapError) -> String {
    let full = match error {
        McapError::Io(e) => matches!(
            e.kind(),
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge
        ),
        _ => false,
    };
    let why = why(error);
    if !full {
        return format!("{why}; choose a path that can be written");
    }
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
    let directory = parent.unwrap_or(Path::new("."));
    format!(
        "no space left on {} ({why}): the file ends before the flight; make room there, or record elsewhere",
        directory.display()
    )
}

/// Messages on their way to the file.
#[derive(Default)]
struct Batch {
    bytes: Vec<u8>,
    /// Channel, time (ns) and end in `bytes` of each message.
    marks: Vec<(u16, u64, usize)>,
}

/// A file that is being written, before its first message.
pub struct Opening(Writer<BufWriter<File>>);

impl Opening {
    /// Creates the file.
    pub fn create(path: &Path) -> Result<Opening, McapError> {
        Opening::of(File::create(path)?, None, false)
    }
    /// Begins in `file`; with `whole_chunks` a chunk is written at once and not as it grows.
    pub fn of(
        file: File,
        compression: Option<Compression>,
        whole_chunks: bool,
    ) -> Result<Opening, McapError> {
        let options = WriteOptions::new()
            .profile("")
            .library(concat!("alight ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(whole_chunks)
            .compression(compression);
        Ok(Opening(
            options.create(BufWriter::with_capacity(BUFFER_BYTES, file))?,
        ))
    }
    /// A channel of bytes that only Alight reads.
    pub fn raw(&mut self, topic: &str, encoding: &str) -> Result<Channel, McapError> {
        Ok(Channel(self.0.add_channel(
            0,
            topic,
            encoding,
            &BTreeMap::new(),
        )?))
    }
    /// A text that belongs to the recording.
    pub fn attach(&mut self, name: &str, text: &str) -> Result<(), McapError> {
        self.0.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: name.into(),
            media_type: "application/toml".into(),
            data: text.as_bytes().into(),
        })
    }
    /// Names and values that belong to the recording.
    pub fn metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), McapError> {
        self.0.write_metadata(&Metadata {
            name: name.into(),
            metadata: values,
        })
    }
    /// For a thread that writes messages itself.
    pub fn into_writer(self) -> Writer<BufWriter<File>> {
        self.0
    }
    /// From now on messages.
    pub fn start(self) -> Sink {
        let (to, batches) = sync_channel(BATCHES);
        let (give_back, free) = sync_channel(BATCHES);
        let writer = self.0;
        Sink {
            batch: Batch::default(),
            to,
            free,
            thread: std::thread::spawn(move || write(writer, &batches, &give_back)),
        }
    }
}

impl OpenChannels for Opening {
    fn protobuf(&mut self, topic: &str, schema: (&str, &[u8])) -> Result<Channel, McapError> {
        let id = self.0.add_schema(schema.0, "protobuf", schema.1)?;
        Ok(Channel(self.0.add_channel(
            id,
            topic,
            "protobuf",
            &BTreeMap::new(),
        )?))
    }
}

fn write(
    mut writer: Writer<BufWriter<File>>,
    batches: &Receiver<Batch>,
    give_back: &SyncSender<Batch>,
) -> Result<Writer<BufWriter<File>>, McapError> {
    let mut sequences = BTreeMap::<u16, u32>::new();
    while let Ok(mut batch) = batches.recv() {
        let mut begin = 0;
        for (channel_id, t, end) in batch.marks.drain(..) {
            let sequence = sequences.entry(channel_id).or_default();
            let header = MessageHeader {
                channel_id,
                sequence: *sequence,
                log_time: t,
                publish_time: t,
            };
            *sequence = sequence.wrapping_add(1);
            writer.write_to_known_channel(&header, batch.bytes.get(begin..end).unwrap_or_default())?;
            begin = end;
        }
        batch.bytes.clear();
        // A full line back only means that this buffer is not used again.
        let _unused = give_back.try_send(batch);
    }
    Ok(writer)
}

/// A file that takes messages.
pub struct Sink {
    batch: Batch,
    to: SyncSender<Batch>,
    free: Receiver<Batch>,
    thread: JoinHandle<Result<Writer<BufWriter<File>>, McapError>>,
}

impl TakeMessages for Sink {
    fn message<E>(
        &mut self,
        channel: Channel,
        t_ns: u64,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E> {
        let begin = self.batch.bytes.len();
        if let Err(e) = encode(&mut self.batch.bytes) {
            self.batch.bytes.truncate(begin);
            return Err(e);
        }
        self.batch.marks.push((channel.0, t_ns, self.batch.bytes.len()));
        if self.batch.bytes.len() >= BATCH_BYTES {
            self.send();
        }
        Ok(())
    }
}

impl Sink {
    fn send(&mut self) {
        let empty = self.free.try_recv().unwrap_or_default();
        // A thread that ended has its error ready for `finish`.
        let _ended = self.to.send(core::mem::replace(&mut self.batch, empty));
    }
    /// Writes what is left, and how it ended.
    pub fn finish(mut self, name: &str, values: &[(&str, String)]) -> Result<(), McapError> {
        let values = values
            .iter()
            .map(|(name, value)| (name.to_string(), value.clone()));
        self.send();
        drop(self.to);
        let Ok(written) = self.thread.join() else {
            return Err(McapError::Io(std::io::Error::other(
                "the writing thread panicked",
            )));
        };
        let mut writer = written?;
        writer.write_metadata(&Metadata {
            name: name.into(),
            metadata: values.collect(),
        })?;
        writer.finish()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recording_on_a_full_disk() {
        // Every write to it fails as on a full disk, whichever comes first.
        let path = Path::new("/dev/full");
        let record = || -> Result<(), McapError> {
            let mut opening = Opening::create(path)?;
            let channel = opening.raw("/node/vessel", "bytes")?;
            let mut sink = opening.start();
            for k in 0..100 {
                sink.message(channel, k, |to: &mut Vec<u8>| -> Result<(), McapError> {
                    to.extend([7; 100_000]);
                    Ok(())
                })?;
            }
            sink.finish("outcome", &[])
        };
        let e = record().unwrap_err();
        let text = unwritable(Path::new("/mnt/stick/l.mcap"), &e);
        assert!(
            text.starts_with("no space left on /mnt/stick (No space left on device"),
            "{text}"
        );
        let denied = McapError::Io(std::io::Error::from(ErrorKind::PermissionDenied));
        assert!(unwritable(path, &denied).contains("choose a path"), "{denied}");
    }
}
