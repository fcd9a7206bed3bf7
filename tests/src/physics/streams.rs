//! One named random stream per noise source, so that two planners meet the same sea and a new
//! source does not shift the others.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// The family of random streams of one seed.
#[derive(Clone, Copy, Debug)]
pub struct Streams {
    seed: u64,
}

impl Streams {
    /// The streams of `seed`.
    pub const fn new(seed: u64) -> Self {
        Streams { seed }
    }
    /// The stream called `name`: the same for the same seed and name, independent of all others.
    pub fn stream(&self, name: &str) -> ChaCha8Rng {
        // FNV-1a (Fowler, Noll, Vo) of the name selects the ChaCha stream.
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
            (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(hash);
        rng
    }
}
