//! Splitter of a byte stream, cut at arbitrary points, into lines of bounded length.

/// End of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Non-empty line without its terminator.
    Line(Vec<u8>),
    /// Line longer than the maximum; its content is dropped.
    Overlong,
}

impl Cut {
    fn line(self, overlong: &mut u64) -> Option<Vec<u8>> {
        match self {
            Cut::Line(line) => Some(line),
            Cut::Overlong => {
                *overlong += 1;
                None
            }
        }
    }
}

/// Buffer of an incomplete line.
#[derive(Clone, Debug)]
pub struct LineBuffer {
    line: Vec<u8>,
    overlong: bool,
    max: usize,
}

impl LineBuffer {
    /// Splitter for lines of at most `max` bytes.
    pub fn new(max: usize) -> Self {
        LineBuffer {
            line: Vec::new(),
            overlong: false,
            max,
        }
    }
    /// Takes a byte. Returns the line that it completes.
    pub fn push(&mut self, byte: u8) -> Option<Cut> {
        match byte {
            b'\n' | b'\r' => return self.end(),
            _ if self.line.len() >= self.max => self.overlong = true,
            _ => self.line.push(byte),
        }
        None
    }
    /// Ends the present line, if any.
    pub fn end(&mut self) -> Option<Cut> {
        let line = core::mem::take(&mut self.line);
        let overlong = core::mem::take(&mut self.overlong);
        if overlong {
            Some(Cut::Overlong)
        } else {
            (!line.is_empty()).then_some(Cut::Line(line))
        }
    }
    /// Returns the lines that these bytes complete, and counts overlong ones.
    pub fn whole(&mut self, bytes: &[u8], overlong: &mut u64) -> Vec<Vec<u8>> {
        bytes
            .iter()
            .filter_map(|byte| self.push(*byte)?.line(overlong))
            .collect()
    }
    /// Returns a last line without a terminator; counts an overlong one.
    pub fn last(&mut self, overlong: &mut u64) -> Option<Vec<u8>> {
        self.end()?.line(overlong)
    }
    /// Drops the present line and returns its beginning.
    pub fn restart(&mut self) -> Vec<u8> {
        self.overlong = false;
        core::mem::take(&mut self.line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_of_bounded_length() {
        let mut lines = LineBuffer::new(4);
        let mut cuts: Vec<Cut> = b"ab\r\n\nabcde\nabcd\nrest"
            .iter()
            .filter_map(|b| lines.push(*b))
            .collect();
        cuts.extend(lines.end());
        let line = |text: &[u8]| Cut::Line(text.to_vec());
        assert_eq!(cuts, [line(b"ab"), Cut::Overlong, line(b"abcd"), line(b"rest")]);
        assert_eq!(lines.end(), None);
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_in_lines(bytes in prop::collection::vec(any::<u8>(), 0..600), max in 1..300_usize) {
            let mut lines = LineBuffer::new(max);
            for byte in bytes {
                if let Some(Cut::Line(line)) = lines.push(byte) {
                    prop_assert!((1..=max).contains(&line.len()));
                }
                prop_assert!(lines.line.len() <= max);
            }
        }
    }
}
