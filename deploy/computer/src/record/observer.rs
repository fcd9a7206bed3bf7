//! Observer of a flight that goes on or is computed again: shown every step, changes none.

use alight_shared::step::Step;
use alight_shared::time::{Time, TrueTime};
use alight_shared::wire::WireError;

use crate::record::entry::PartHeader;

/// Is shown each step.
pub trait StepObserver {
    /// A step at `t`, the world's time.
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>);
    /// A step that is not computed again, of the simulated world or of a row that lacks an input, as its process recorded it.
    fn recorded(&mut self, _t: Time<TrueTime>, _of: &PartHeader, _entry: &[u8]) -> Result<(), WireError> {
        Ok(())
    }
}

/// All of them.
impl StepObserver for Vec<&mut dyn StepObserver> {
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        self.iter_mut().for_each(|o| o.step(t, step));
    }
    fn recorded(&mut self, t: Time<TrueTime>, of: &PartHeader, entry: &[u8]) -> Result<(), WireError> {
        self.iter_mut().try_for_each(|o| o.recorded(t, of, entry))
    }
}
