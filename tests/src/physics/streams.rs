//! One named random stream per noise source, so that two planners meet the same sea and a new
//! source does not shift the others.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Streams are drawn anew in groups ([`Streams::redrawn`]).
pub const GROUPS: usize = 8;

/// The family of random streams of one seed, or of one seed for each group of names.
#[derive(Clone, Copy, Debug)]
pub struct Streams {
    seeds: [u64; GROUPS],
    /// FNV-1a hash of what stands before every name.
    prefix: u64,
}

/// FNV-1a (Fowler, Noll, Vo) of a name that goes on from `hash`.
fn fnv(hash: u64, name: &str) -> u64 {
    name.bytes().fold(hash, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

impl Streams {
    /// The streams of `seed`.
    pub const fn new(seed: u64) -> Self {
        Streams {
            seeds: [seed; GROUPS],
            prefix: 0xcbf2_9ce4_8422_2325,
        }
    }
    /// The streams of drone `k`, counted from 0: those of the first are the plain ones.
    pub fn of_drone(&self, k: usize) -> Self {
        let prefix = if k == 0 {
            self.prefix
        } else {
            fnv(self.prefix, &format!("drone {k}: "))
        };
        Streams { prefix, ..*self }
    }
    /// The same with one group of streams drawn anew from `seed`; the name's hash says to which group a stream belongs.
    #[must_use]
    pub fn redrawn(&self, group: usize, seed: u64) -> Self {
        let mut redrawn = *self;
        redrawn
            .seeds
            .iter_mut()
            .skip(group)
            .take(1)
            .for_each(|s| *s = seed);
        redrawn
    }
    /// The stream called `name`: the same for the same seed and name, independent of all others.
    pub fn stream(&self, name: &str) -> ChaCha8Rng {
        let hash = fnv(self.prefix, name);
        let group = (hash >> 32) as usize % GROUPS;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seeds.get(group).copied().unwrap_or_default());
        // The hash selects the ChaCha stream.
        rng.set_stream(hash);
        rng
    }
}

impl From<u64> for Streams {
    fn from(seed: u64) -> Streams {
        Streams::new(seed)
    }
}
