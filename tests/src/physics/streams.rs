//! Named random streams, one per noise source. Planners compared on a seed therefore experience the same sea,
//! and adding a source does not change the others.

use std::convert::Infallible;

use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng, TryRng},
};

pub const MOVES: usize = 10;

/// Shifts every number of every stream by a step drawn from `seed`, modulo the range. The step is `bits`
/// binary digits smaller than the range. Numbers stay uniform, and a shift is as probable as its reverse, as
/// a Markov chain over random numbers requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Move {
    seed: u64,
    bits: u32,
}

/// Random streams of a seed, and the shifts applied to their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Streams {
    seed: u64,
    moves: [Option<Move>; MOVES],
    /// FNV-1a hash of the prefix of the names.
    prefix: u64,
}

/// FNV-1a hash (Fowler, Noll, Vo) of a name, continued from `hash`.
fn fnv(hash: u64, name: &str) -> u64 {
    name.bytes().fold(hash, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

impl Streams {
    pub const fn new(seed: u64) -> Self {
        Streams {
            seed,
            moves: [None; MOVES],
            prefix: 0xcbf2_9ce4_8422_2325,
        }
    }
    /// Streams of drone `k`, counted from 0; the first drone's have no prefix.
    pub fn of_drone(&self, k: usize) -> Self {
        let prefix = if k == 0 {
            self.prefix
        } else {
            fnv(self.prefix, &format!("drone {k}: "))
        };
        Streams { prefix, ..*self }
    }
    /// Shifts every number by a step uniform over `2^-bits` of the range: 0 redraws all numbers, 6 changes
    /// each by at most 0.8 %. After [`MOVES`] shifts the streams no longer change.
    #[must_use]
    pub fn moved(&self, seed: u64, bits: u32) -> Self {
        let mut moved = *self;
        if let Some(free) = moved.moves.iter_mut().find(|m| m.is_none()) {
            *free = Some(Move { seed, bits });
        }
        moved
    }
    /// Stream that is reproducible for a seed and name, and independent of all other streams.
    pub fn stream(&self, name: &str) -> Stream {
        let hash = fnv(self.prefix, name);
        let generator = |seed: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(hash);
            rng
        };
        Stream {
            plain: generator(self.seed),
            steps: self
                .moves
                .iter()
                .flatten()
                .map(|m| (generator(m.seed), m.bits))
                .collect(),
        }
    }
}

impl From<u64> for Streams {
    fn from(seed: u64) -> Streams {
        Streams::new(seed)
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    plain: ChaCha8Rng,
    /// One source of steps per shift; all steps add to the stream's numbers.
    steps: Vec<(ChaCha8Rng, u32)>,
}

impl Stream {
    /// Sum of the shifts' steps for the next number. The last 12 binary digits are kept: they select a
    /// section of a distribution (a layer of the ziggurat), where a small step would cause a jump.
    fn step(&mut self) -> u64 {
        self.steps.iter_mut().fold(0, |sum: u64, (rng, bits)| {
            let step = (rng.next_u64().cast_signed() >> *bits).cast_unsigned();
            let whole = *bits == 0;
            sum.wrapping_add(if whole { step } else { step & !0xfff })
        })
    }
}

impl TryRng for Stream {
    type Error = Infallible;
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        let step = (self.step() >> 32) as u32;
        Ok(self.plain.next_u32().wrapping_add(step))
    }
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        let step = self.step();
        Ok(self.plain.next_u64().wrapping_add(step))
    }
    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for part in bytes.chunks_mut(8) {
            let random = self.next_u64().to_le_bytes();
            for (b, r) in part.iter_mut().zip(random) {
                *b = r;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn moved_numbers_stay_uniform_and_near() {
        let streams = Streams::new(7);
        let numbers = |s: &Streams| -> Vec<f64> {
            let mut stream = s.stream("sea");
            (0..4000).map(|_| stream.random::<f64>()).collect()
        };
        let plain = numbers(&streams);
        for bits in [0, 3, 6] {
            let moved = numbers(&streams.moved(3, bits).moved(4, bits));
            // On a circle, two steps of at most 2^-bits / 2 each.
            let way = |(a, b): (&f64, &f64)| ((a - b + 1.5).rem_euclid(1.0) - 0.5).abs();
            let most = plain.iter().zip(&moved).map(way).fold(0.0, f64::max);
            assert!(
                most <= 0.5_f64.powi(bits.cast_signed()) && most > 0.0,
                "{bits}: {most}"
            );
            let mean = moved.iter().sum::<f64>() / moved.len() as f64;
            assert!((mean - 0.5).abs() < 0.02, "{bits}: {mean}");
        }
    }

    #[test]
    fn moves_of_the_one_stream_by_their_own_numbers() {
        let moved = Streams::new(7).moved(3, 3);
        let mut sea = moved.stream("sea");
        let mut wind = moved.stream("wind");
        assert_ne!(sea.next_u64(), wind.next_u64());
        assert_eq!(moved.stream("sea").next_u64(), moved.stream("sea").next_u64());
        assert_ne!(
            moved.stream("sea").next_u64(),
            Streams::new(7).stream("sea").next_u64()
        );
    }
}
