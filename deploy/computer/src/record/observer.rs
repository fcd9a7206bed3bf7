//! Observer of a running or replayed flight, which receives every step and changes none.

use alight_shared::{step::Step, time::WorldTime, wire::WireError};

use crate::record::entry::PartHeader;

pub trait StepObserver {
    fn step(&mut self, t: WorldTime, step: &Step<'_>);
    /// Step that is recorded but not replayed: of the simulated world, or of a row that lacks an input.
    fn recorded(&mut self, _t: WorldTime, _of: &PartHeader, _entry: &[u8]) -> Result<(), WireError> {
        Ok(())
    }
}

impl StepObserver for Vec<&mut dyn StepObserver> {
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        for o in self.iter_mut() {
            o.step(t, step);
        }
    }
    fn recorded(&mut self, t: WorldTime, of: &PartHeader, entry: &[u8]) -> Result<(), WireError> {
        self.iter_mut().try_for_each(|o| o.recorded(t, of, entry))
    }
}
