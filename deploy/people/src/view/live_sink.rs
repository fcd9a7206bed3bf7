use std::sync::Arc;

use alight_computer::record::sink::{ChannelId, OpenChannels, TakeMessages};
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema};
use mcap::McapError;

/// Channels of a Foxglove server. Messages of a channel without a subscriber are not encoded.
pub struct LiveSink {
    context: Arc<Context>,
    channels: Vec<Arc<RawChannel>>,
    scratch: Vec<u8>,
}

impl LiveSink {
    pub fn new(context: &Arc<Context>) -> LiveSink {
        LiveSink {
            context: Arc::clone(context),
            channels: Vec::new(),
            scratch: Vec::new(),
        }
    }
    /// Whether a viewer has subscribed to a topic.
    pub fn is_watched(&self) -> bool {
        self.channels.iter().any(|channel| channel.has_sinks())
    }
}

impl OpenChannels for LiveSink {
    fn protobuf(&mut self, topic: &str, schema: (&str, &[u8])) -> Result<ChannelId, McapError> {
        let other = |e: String| McapError::Io(std::io::Error::other(e));
        let number = u16::try_from(self.channels.len()).map_err(|e| other(e.to_string()))?;
        let channel = ChannelBuilder::new(topic)
            .message_encoding("protobuf")
            .schema(Schema::new(schema.0, "protobuf", schema.1.to_vec()))
            .context(&self.context)
            .build_raw()
            .map_err(|e| other(e.to_string()))?;
        self.channels.push(channel);
        Ok(ChannelId(number))
    }
}

impl TakeMessages for LiveSink {
    fn message<E>(
        &mut self,
        channel: ChannelId,
        t_ns: u64,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(channel) = self.channels.get(usize::from(channel.0)) else {
            return Ok(());
        };
        if channel.has_sinks() {
            self.scratch.clear();
            encode(&mut self.scratch)?;
            let at = PartialMetadata { log_time: Some(t_ns) };
            channel.log_with_meta(&self.scratch, at);
        }
        Ok(())
    }
}
