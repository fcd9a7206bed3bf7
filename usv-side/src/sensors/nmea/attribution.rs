//! To which time sentences without one belong, by the order and the pauses in which they arrive.

/// Kinds of sentences without a time.
pub(super) const KINDS: usize = 4;
/// After so many epochs in a row that speak for the other side of the time, a kind belongs there.
const CHANGE: u8 = 3;
/// After so many epochs in a row with several of a kind, it is a device's of its own.
const SEVERAL: u8 = 2;
/// Without any time for so long, a source has none, ns.
const TIMELESS_NS: i64 = 2_000_000_000;

#[derive(Clone, Copy, Debug, Default)]
struct Kind {
    /// They come before the sentence with their time.
    leads: bool,
    /// Epochs in a row that speak for the other.
    against: u8,
    /// Number that came since the last new time, and in how many epochs in a row several did.
    count: u32,
    several: u8,
    /// Arrival of the newest, and how long after the newest sentence with a time it came, ns.
    arrived: Option<(i64, i64)>,
}

/// The attribution of all kinds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attribution {
    kinds: [Kind; KINDS],
    /// Arrival of the bytes that are being read, ns; None in a recording.
    pub(super) now_ns: Option<i64>,
    first_ns: Option<i64>,
    /// Arrival of the newest sentence with a time.
    timed_ns: Option<i64>,
}

impl Attribution {
    /// All kinds before or after the sentence with their time until their arrivals show it.
    pub(super) fn new(leads: bool) -> Self {
        let kind = Kind {
            leads,
            // The first epoch decides.
            against: CHANGE - 1,
            ..Kind::default()
        };
        Attribution {
            kinds: [kind; KINDS],
            now_ns: None,
            first_ns: None,
            timed_ns: None,
        }
    }
    /// Bytes arrive.
    pub(super) fn arrive(&mut self, now_ns: i64) {
        self.now_ns = Some(now_ns);
        self.first_ns.get_or_insert(now_ns);
    }
    /// A sentence with a time arrived; `new`: another than the last.
    pub(super) fn timed(&mut self, new: bool) {
        if let (true, Some(now)) = (new, self.now_ns) {
            for kind in &mut self.kinds {
                kind.end_epoch(now);
            }
        }
        self.timed_ns = self.now_ns;
    }
    /// A sentence without a time arrived.
    pub(super) fn untimed(&mut self, kind: usize) {
        let (now, timed) = (self.now_ns, self.timed_ns);
        if let Some(k) = self.kinds.get_mut(kind) {
            k.count = k.count.saturating_add(1);
            k.arrived = now
                .zip(timed)
                .map(|(now, timed)| (now, now.saturating_sub(timed)));
        }
    }
    /// It belongs to the next time.
    pub(super) fn leads(&self, kind: usize) -> bool {
        self.kinds.get(kind).is_some_and(|k| k.leads)
    }
    /// The arrival, where that is its time: several come with each time, or no time comes at all.
    pub(super) fn own_time(&self, kind: usize) -> Option<i64> {
        let now = self.now_ns?;
        let since = now.saturating_sub(self.timed_ns.or(self.first_ns)?);
        let several = self.kinds.get(kind).is_some_and(|k| k.several >= SEVERAL);
        (several || since > TIMELESS_NS).then_some(now)
    }
}

impl Kind {
    /// The next time arrived at `now`: the newest of this kind belongs to the nearer of the two, where that is clear.
    fn end_epoch(&mut self, now: i64) {
        if let (1, Some((arrived, after))) = (self.count, self.arrived) {
            let before = now.saturating_sub(arrived);
            let leads = match (before.saturating_mul(2) < after, after.saturating_mul(2) < before) {
                (true, _) => Some(true),
                (_, true) => Some(false),
                (false, false) => None,
            };
            if let Some(leads) = leads {
                self.against = if leads == self.leads { 0 } else { self.against + 1 };
                if self.against >= CHANGE {
                    (self.leads, self.against) = (leads, 0);
                }
            }
        }
        match self.count {
            0 => {}
            1 => self.several = 0,
            _ => self.several = (self.several + 1).min(SEVERAL),
        }
        (self.count, self.arrived) = (0, None);
    }
}
