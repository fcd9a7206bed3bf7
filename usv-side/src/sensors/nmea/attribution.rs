//! Attribution of sentences without a time to an epoch, from the order and the pauses of their arrivals.

/// Kinds of sentences without a time.
pub(super) const KINDS: usize = 4;
/// Consecutive epochs with evidence for the other side of the time stamp that move a kind of sentence there.
const CHANGE: u8 = 3;
/// Consecutive epochs with several sentences of a kind after which it is treated as a separate device.
const SEVERAL: u8 = 2;
/// Time without any time stamp after which a source is taken to have none, ns.
const TIMELESS_NS: i64 = 2_000_000_000;

#[derive(Clone, Copy, Debug, Default)]
struct Kind {
    /// Sentences of this kind precede the sentence with their time.
    leads: bool,
    /// Number of consecutive epochs with evidence for the opposite order.
    against: u8,
    /// Sentences since the last new time, and consecutive epochs with several.
    count: u32,
    several: u8,
    /// Arrival of the newest sentence, and its delay after the last time, ns.
    arrived: Option<(i64, i64)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Attribution {
    kinds: [Kind; KINDS],
    /// Arrival of the bytes being read, ns; None in a recording.
    pub(super) now_ns: Option<i64>,
    first_ns: Option<i64>,
    /// Arrival of the newest sentence with a time.
    timed_ns: Option<i64>,
}

impl Attribution {
    /// Initial assumption for all kinds, until their arrivals show the order.
    pub(super) fn new(leads: bool) -> Self {
        let kind = Kind {
            leads,
            // A single epoch is sufficient at the start.
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
    pub(super) fn arrive(&mut self, now_ns: i64) {
        self.now_ns = Some(now_ns);
        self.first_ns.get_or_insert(now_ns);
    }
    /// Records a sentence with a time; `new` if that differs from the previous one.
    pub(super) fn timed(&mut self, new: bool) {
        if let (true, Some(now)) = (new, self.now_ns) {
            for kind in &mut self.kinds {
                kind.end_epoch(now);
            }
        }
        self.timed_ns = self.now_ns;
    }
    pub(super) fn untimed(&mut self, kind: usize) {
        let (now, timed) = (self.now_ns, self.timed_ns);
        if let Some(k) = self.kinds.get_mut(kind) {
            k.count = k.count.saturating_add(1);
            k.arrived = now
                .zip(timed)
                .map(|(now, timed)| (now, now.saturating_sub(timed)));
        }
    }
    pub(super) fn leads(&self, kind: usize) -> bool {
        self.kinds.get(kind).is_some_and(|k| k.leads)
    }
    /// Arrival of a kind that is dated by arrival: several sentences arrive per time stamp, or no time stamp is sent.
    pub(super) fn own_time(&self, kind: usize) -> Option<i64> {
        let now = self.now_ns?;
        let since = now.saturating_sub(self.timed_ns.or(self.first_ns)?);
        let several = self.kinds.get(kind).is_some_and(|k| k.several >= SEVERAL);
        (several || since > TIMELESS_NS).then_some(now)
    }
}

impl Kind {
    /// Ends the epoch at the next time. A kind's newest sentence goes to the nearer time, if clearly nearer.
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
