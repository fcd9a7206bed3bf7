//! Check of an MCAP file's records before a reader allocates memory for them: the reader trusts a chunk's stated
//! size, and a damaged size would end the program.

use core::ops::Range;

/// Maximum number of bytes in a chunk; ours are far smaller.
pub const MAX_CHUNK_BYTES: u64 = 256 * 1024 * 1024;
/// Magic bytes at both ends of a file, and opcode of a chunk (MCAP specification, "Format").
const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const CHUNK: u8 = 0x06;
/// Opcode that no record has: a file system leaves zeros in a block that was never written.
const NONE: u8 = 0;

fn number(bytes: &[u8], at: usize) -> Option<u64> {
    let slice = bytes.get(at..at.checked_add(8)?)?;
    slice.try_into().ok().map(u64::from_le_bytes)
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    pub end: usize,
    /// Description of the invalid rest of the file; None: the file was finished.
    pub cut: Option<String>,
    /// Places of the chunks, each with opcode and length.
    pub chunks: Vec<Range<usize>>,
}

impl Outline {
    /// Checks the records of `file`; an error if its beginning is invalid.
    pub fn of(file: &[u8]) -> Result<Outline, String> {
        if !file.starts_with(MAGIC) {
            return Err("it does not begin as an MCAP file does".into());
        }
        let mut outline = Outline {
            end: MAGIC.len(),
            cut: None,
            chunks: Vec::new(),
        };
        // Each iteration advances by at least 9 bytes, so the file's length bounds the loop.
        while let Some(opcode) = file.get(outline.end).copied() {
            if file.get(outline.end..) == Some(MAGIC) {
                return Ok(outline);
            }
            match record_end(file, outline.end, opcode) {
                Ok(end) => {
                    if opcode == CHUNK {
                        outline.chunks.push(outline.end..end);
                    }
                    outline.end = end;
                }
                Err(why) => {
                    outline.cut = Some(why);
                    return Ok(outline);
                }
            }
        }
        outline.cut = Some(CUT_OFF.into());
        Ok(outline)
    }
}

const CUT_OFF: &str = "it ends within a record; it may have been cut off";

/// End of the record at byte `at`.
fn record_end(file: &[u8], at: usize, opcode: u8) -> Result<usize, String> {
    let length = number(file, at + 1).ok_or(CUT_OFF)?;
    let begin = at + 9;
    let end = usize::try_from(length)
        .ok()
        .and_then(|l| begin.checked_add(l))
        .filter(|e| *e <= file.len());
    let Some(end) = end else {
        return Err(format!(
            "the record at byte {at} claims {length} bytes, more than the file has"
        ));
    };
    // A chunk begins with two times, followed by its uncompressed size.
    if opcode == CHUNK
        && let Some(size) = number(file, begin + 16)
        && size > MAX_CHUNK_BYTES
    {
        return Err(format!(
            "the chunk at byte {at} claims {size} bytes; at most {MAX_CHUNK_BYTES} are accepted"
        ));
    }
    if opcode == NONE {
        return Err(format!("byte {at} begins no record"));
    }
    Ok(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(opcode: u8, length: u64, content: &[u8]) -> Vec<u8> {
        [MAGIC, &[opcode], &length.to_le_bytes(), content, MAGIC].concat()
    }

    fn check(file: &[u8]) -> Result<(), String> {
        Outline::of(file)?.cut.map_or(Ok(()), Err)
    }

    #[test]
    fn outline_of_whole_files_and_false_lengths() {
        assert!(check(&file(1, 3, b"abc")).is_ok());
        assert!(check(&file(1, u64::MAX, b"abc")).is_err());
        assert!(check(b"not a recording").is_err());
        assert!(check(&file(1, 3, b"abc")[..15]).is_err());
        let mut chunk = vec![0; 40];
        assert!(check(&file(CHUNK, 40, &chunk)).is_ok());
        chunk[23] = 0x20;
        assert!(check(&file(CHUNK, 40, &chunk)).is_err());
    }

    #[test]
    fn outline_of_a_cut_file() {
        let whole = file(1, 3, b"abc");
        let end = whole.len() - MAGIC.len();
        for cut in MAGIC.len()..whole.len() {
            let found = Outline::of(&whole[..cut]).unwrap();
            let expected = if cut < end { MAGIC.len() } else { end };
            assert_eq!(found.end, expected, "{cut}");
            assert!(found.cut.is_some(), "{cut}");
        }
        let zeros = [&whole[..end], &[0; 4096]].concat();
        assert_eq!(Outline::of(&zeros).unwrap().end, end);
    }
}
