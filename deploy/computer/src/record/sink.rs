use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, ErrorKind, Write},
    path::Path,
};

use mcap::{
    Attachment, Compression, McapError, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};

use crate::record::{
    PROCESS,
    entry::{ENCODING, PartHeader},
    topic,
};

const CHUNK_BYTES: u64 = 1 << 20;
const BUFFER_BYTES: usize = 1 << 20;

#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelId(pub u16);

pub trait OpenChannels {
    /// Opens a channel; `schema` is its name and file descriptor set.
    fn protobuf(&mut self, topic: &str, schema: (&str, &[u8])) -> Result<ChannelId, McapError>;
}

pub trait TakeMessages {
    /// Writes a message of time `t_ns`, which `encode` appends to the given buffer.
    fn message<E>(
        &mut self,
        channel: ChannelId,
        t_ns: u64,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E>;
}

/// Error text for users: the system's own, if there is one.
pub fn why(error: &McapError) -> String {
    match error {
        McapError::Io(e) => e.to_string(),
        other => other.to_string(),
    }
}

/// Error text for a file that could not be written, with the remedy.
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

pub struct Sink {
    writer: Writer<BufWriter<File>>,
    sequences: BTreeMap<u16, u32>,
    scratch: Vec<u8>,
    /// First error, after which all messages are lost.
    failed: Option<McapError>,
}

impl Sink {
    /// Creates a recording. It is not compressed: LZ4 would halve the file and double the processor time of
    /// recording.
    pub fn create(path: &Path) -> Result<Sink, McapError> {
        Sink::of(File::create(path)?, None, false)
    }
    /// Begins a log in `file`. If `whole_chunks`, each chunk is written when complete, otherwise as it grows.
    pub fn of(file: File, compression: Option<Compression>, whole_chunks: bool) -> Result<Sink, McapError> {
        let options = WriteOptions::new()
            .profile("")
            .library(concat!("alight ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(whole_chunks)
            .compression(compression);
        Ok(Sink {
            writer: options.create(BufWriter::with_capacity(BUFFER_BYTES, file))?,
            sequences: BTreeMap::new(),
            scratch: Vec::new(),
            failed: None,
        })
    }
    /// Writes the header of a start that follows these earlier starts; returns the channel of its steps.
    pub fn process<'a>(
        &mut self,
        header: &PartHeader,
        before: impl Iterator<Item = &'a PartHeader> + Clone,
    ) -> Result<ChannelId, McapError> {
        // Processes of one computer share a configuration.
        let same = before.clone().find(|h| h.config == header.config);
        let name = format!("{}.toml", same.unwrap_or(header).process);
        if same.is_none() {
            self.attach(&name, &header.config)?;
        }
        self.metadata(PROCESS, header.values(&name))?;
        let topic = topic(header, before);
        let none = BTreeMap::new();
        Ok(ChannelId(self.writer.add_channel(0, &topic, ENCODING, &none)?))
    }
    /// Stores the error; later messages are lost.
    pub fn fail(&mut self, error: McapError) {
        self.failed.get_or_insert(error);
    }
    pub fn attach(&mut self, name: &str, text: &str) -> Result<(), McapError> {
        self.writer.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: name.into(),
            media_type: "application/toml".into(),
            data: text.as_bytes().into(),
        })
    }
    pub fn metadata(&mut self, name: &str, values: BTreeMap<String, String>) -> Result<(), McapError> {
        self.writer.write_metadata(&Metadata {
            name: name.into(),
            metadata: values,
        })
    }
    pub fn write(
        &mut self,
        channel: ChannelId,
        sequence: u32,
        t_ns: u64,
        bytes: &[u8],
    ) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id: channel.0,
            sequence,
            log_time: t_ns,
            publish_time: t_ns,
        };
        self.writer.write_to_known_channel(&header, bytes)
    }
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()
    }
    /// Writes the end of the file; an error if a message was lost.
    pub fn finish(mut self) -> Result<(), McapError> {
        if let Some(e) = self.failed {
            return Err(e);
        }
        self.writer.finish()?;
        self.writer.into_inner().flush()?;
        Ok(())
    }
}

impl OpenChannels for Sink {
    fn protobuf(&mut self, topic: &str, schema: (&str, &[u8])) -> Result<ChannelId, McapError> {
        let id = self.writer.add_schema(schema.0, "protobuf", schema.1)?;
        let none = BTreeMap::new();
        Ok(ChannelId(self.writer.add_channel(id, topic, "protobuf", &none)?))
    }
}

impl TakeMessages for Sink {
    fn message<E>(
        &mut self,
        channel: ChannelId,
        t_ns: u64,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut bytes = core::mem::take(&mut self.scratch);
        bytes.clear();
        let encoded = encode(&mut bytes);
        if encoded.is_ok() && self.failed.is_none() {
            let next = self.sequences.entry(channel.0).or_default();
            let sequence = *next;
            *next = next.wrapping_add(1);
            self.failed = self.write(channel, sequence, t_ns, &bytes).err();
        }
        self.scratch = bytes;
        encoded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recording_on_a_full_disk() {
        // Every write to this file fails as on a full disk.
        let path = Path::new("/dev/full");
        let record = || -> Result<(), McapError> {
            let mut sink = Sink::create(path)?;
            let channel = sink.process(&PartHeader::default(), std::iter::empty())?;
            for k in 0..100 {
                sink.message(channel, k, |to: &mut Vec<u8>| -> Result<(), McapError> {
                    to.extend([7; 100_000]);
                    Ok(())
                })?;
            }
            sink.finish()
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
