use alight_shared::{
    admission::{Periodic, RejectionReason, Rejections},
    bus::wiring,
    frames::wrap_angle,
    msg::{
        AutopilotState, DeckBeacon, DeckForecast, DroneState, Header, LinkState, Message, MissionState,
        PREDICTED_SLOPE_STEP_S, Plan, PredictorCheckpoint, RangeSample, RelativePlace, SILENT_S,
        SLOPE_WINDOWS, Seq, Source, TagPose, UvdarFix, VesselEstimate, VesselPrediction, VesselSurroundings,
        WaveModel,
    },
    node::Node,
    surroundings::Surroundings,
    time::{DroneClock, DroneTime, Span, Time},
    topics,
};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

mod by_beacon;
mod moving_base;
mod radio;
mod vision;

use super::{
    agreement::HeightAgreement,
    axis::{Axis, AxisNoise, MEAN, MeasurementRow, RATE, VISION},
    beacon::{BeaconEstimate, BeaconTrack, Level},
    checkpoint,
    config::PredictorConfig,
    filter::{Filter, Fused},
    forecast::Horizon,
    identity::{Decks, Verdict},
    level::MeanDeckLevel,
    measurement,
    observation::{self, DeckObservation, ObservationKind},
    own::OwnModel,
    relative::RelativeTrust,
    succession::PredictorSuccession,
    track::DroneTrack,
    waves::{AXES, Waves},
};
use ObservationKind::{Estimate, Range, Tag};

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PredictorIn {
    pub estimate: Option<VesselEstimate<DroneClock>>,
    pub wave: Option<WaveModel<DroneClock>>,
    /// The vessel's own prediction, used for its deviation.
    pub prediction: Option<VesselPrediction<DroneClock>>,
    pub surroundings: Option<VesselSurroundings<DroneClock>>,
    pub link: Option<LinkState>,
    pub drone: Option<DroneState>,
    /// Gives the sea level in the autopilot's frame.
    pub autopilot: Option<AutopilotState>,
    pub beacons: Vec<DeckBeacon>,
    pub tags: Vec<TagPose>,
    pub uvdar: Vec<UvdarFix>,
    pub ranges: Vec<RangeSample>,
    pub relative: Vec<RelativePlace>,
    /// Plan and mission of a drone in flight, for a successor.
    pub plan: Option<Plan>,
    pub mission: Option<MissionState>,
    pub checkpoint: Option<PredictorCheckpoint>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PredictorOut {
    /// Published at the predictor's rate while the deck's position is known.
    pub forecast: Option<DeckForecast>,
    /// For a successor; published with each forecast once the camera has detected the deck.
    pub checkpoint: Option<PredictorCheckpoint>,
}

wiring! {
    PredictorPorts of Predictor: PredictorIn => PredictorOut {
        reads {
            newest estimate: VesselEstimate<DroneClock>,
            newest wave: WaveModel<DroneClock>,
            newest prediction: VesselPrediction<DroneClock>,
            newest surroundings: VesselSurroundings<DroneClock>,
            newest link: LinkState,
            newest drone: DroneState,
            newest autopilot: AutopilotState,
            all beacons: DeckBeacon,
            all tags: TagPose,
            all uvdar: UvdarFix,
            all ranges: RangeSample,
            all relative: RelativePlace,
            newest plan: Plan,
            newest mission: MissionState,
        }
        writes { forecast: DeckForecast }
        wakes { DroneState }
        saves { checkpoint: PredictorCheckpoint }
    }
}

/// Maximum time by which a message may be ahead of now: jitter between processes.
const AHEAD: Span = Span::from_millis(20);
const CAMERA: [ObservationKind; 2] = ObservationKind::CAMERA;
/// Clock standard deviation before the first link state, s.
const CLOCK_SD_UNKNOWN_S: f64 = 0.05;

#[derive(Clone, Debug)]
pub struct Predictor {
    config: PredictorConfig,
    boot: u32,
    sequence: u32,
    waves: Waves,
    filter: Option<Filter>,
    horizon: Horizon,
    /// Longer horizon with longer steps.
    far: Horizon,
    track: DroneTrack,
    clock_sd_s: f64,
    /// Variances (value, rate) stated by the vessel.
    stated: [(f64, f64); AXES],
    radio_sequence: Option<(u32, u32)>,
    /// Last detection of another vessel's tags: time, distance from the position by radio, and its limit, m.
    elsewhere: Option<(DroneTime, [f64; 2])>,
    relative: RelativeTrust,
    height: HeightAgreement,
    level: MeanDeckLevel,
    decks: Decks,
    beacon: Option<BeaconTrack>,
    /// Track from the last known position by radio or camera.
    last_known: Option<BeaconTrack>,
    /// Height of the origin above mean sea level, m.
    origin_sea_m: Option<f64>,
    /// Model identified by the drone while the radio is silent.
    own: Option<OwnModel>,
    /// Apparent slopes of the deck as reported by the vessel, and their time.
    slopes: Option<(DroneTime, Seq<u8, SLOPE_WINDOWS>)>,
    surroundings: Surroundings,
    next: Periodic<DroneClock>,
    /// Set until the forecast agrees with what a predecessor left.
    succession: Option<PredictorSuccession>,
    rejections: Rejections,
}

impl Predictor {
    /// `boot` is a random number, drawn at each start.
    pub fn new(config: &PredictorConfig, boot: u32) -> Self {
        let waves = Waves::new(config);
        Predictor {
            horizon: Horizon::new(&waves.oscillators(Time::default()), config.stage_s),
            far: Horizon::new(&waves.oscillators(Time::default()), PREDICTED_SLOPE_STEP_S),
            config: config.clone(),
            boot,
            sequence: 0,
            waves,
            filter: None,
            track: DroneTrack::default(),
            clock_sd_s: CLOCK_SD_UNKNOWN_S,
            stated: [(0.0, 0.0); AXES],
            radio_sequence: None,
            elsewhere: None,
            relative: RelativeTrust::default(),
            height: HeightAgreement::default(),
            level: MeanDeckLevel::default(),
            decks: Decks::default(),
            beacon: None,
            last_known: None,
            origin_sea_m: None,
            own: None,
            slopes: None,
            surroundings: Surroundings::default(),
            next: Periodic::default(),
            succession: None,
            rejections: Rejections::default(),
        }
    }
    pub fn boot(&self) -> u32 {
        self.boot
    }
    /// Configures a restart after a possible crash.
    #[must_use]
    pub fn as_successor(self) -> Self {
        Predictor {
            succession: Some(PredictorSuccession::default()),
            ..self
        }
    }
    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }

    fn admit<M: Message<Clock = DroneClock>>(now: DroneTime, m: &M) -> Result<(), RejectionReason> {
        m.check().map_err(|_| RejectionReason::OutOfRange)?;
        if m.header().at > now + AHEAD {
            return Err(RejectionReason::Future);
        }
        Ok(())
    }

    fn fused_at(&self, kinds: &[ObservationKind]) -> Option<DroneTime> {
        let filter = self.filter.as_ref()?;
        kinds.iter().filter_map(|k| filter.source(*k).fused_at).max()
    }
    /// Time since the newest fused observation of these kinds, s; infinite without one.
    fn age_s(&self, now: DroneTime, kinds: &[ObservationKind]) -> f64 {
        self.fused_at(kinds)
            .map_or(f64::INFINITY, |t| (now - t).secs().max(0.0))
    }

    fn fuse(&mut self, o: &DeckObservation) -> Result<(), RejectionReason> {
        if let Some(own) = self
            .own
            .as_mut()
            .filter(|_| !matches!(o.kind, ObservationKind::Estimate | ObservationKind::Relative))
        {
            own.fuse(&self.config, o, self.filter.as_ref().and_then(Filter::last));
        }
        let waves = &self.waves;
        let noise = AxisNoise::all(&self.config);
        let filter = self
            .filter
            .get_or_insert_with(|| Filter::new(noise, self.config.gate_sd, waves, o));
        match filter.fuse(waves, o) {
            Fused::All => Ok(()),
            // A partly fused observation counts both as used and as an outlier.
            Fused::Rejected(n)
                if n < 3 && !matches!(o.kind, ObservationKind::Range | ObservationKind::Relative) =>
            {
                self.rejections.count(RejectionReason::Outlier);
                Ok(())
            }
            Fused::Rejected(_) => Err(RejectionReason::Outlier),
            Fused::Late => Err(RejectionReason::Stale),
            Fused::Duplicate => Err(RejectionReason::Duplicate),
        }
    }

    fn drone(&mut self, now: DroneTime, s: &DroneState) -> Result<(), RejectionReason> {
        Self::admit(now, s)?;
        if let Some(last) = self.track.newest() {
            if s.header.at == last.header.at {
                return Err(RejectionReason::Duplicate);
            }
            if s.header.at < last.header.at {
                return Err(RejectionReason::Stale);
            }
            if s.datum != last.datum {
                self.forget_frame();
            }
        }
        if let Some(jump) = self.track.push(s) {
            self.decks.shift(&jump);
            self.relative.forget_frame();
            if let Some(f) = &mut self.filter {
                f.shift(&jump);
            }
            if let Some(own) = &mut self.own {
                own.shift(&jump);
            }
            if let Some(b) = &mut self.beacon {
                b.shift(&jump);
            }
        }
        Ok(())
    }

    /// Discards everything known relative to the drone's previous origin.
    fn forget_frame(&mut self) {
        self.track = DroneTrack::default();
        self.filter = None;
        self.own = None;
        self.radio_sequence = None;
        self.elsewhere = None;
        self.relative.forget_frame();
        self.height = HeightAgreement::default();
        self.level = MeanDeckLevel::default();
        self.decks = Decks::default();
    }

    fn range(&mut self, now: DroneTime, m: &RangeSample) -> Result<(), RejectionReason> {
        Self::admit(now, m)?;
        let at = m.header.at;
        let period = Span::from_secs(self.config.range_period_s);
        let newest = self.filter.as_ref().and_then(|f| f.source(Range).measured_at);
        if newest.is_some_and(|t| at - t < period) {
            return Ok(());
        }
        let pose = self.track.at(at).ok_or(RejectionReason::NoDroneState)?;
        let Some(f) = &self.filter else {
            return Ok(());
        };
        let axes = f.at(&self.waves, at);
        let modes = self.waves.motion(at);
        let lever_arm = self.waves.lever_arm();
        let deck = measurement::plane(&axes, &modes, lever_arm);
        let Some(o) = observation::range(m, &pose, &deck, &self.config) else {
            return Ok(());
        };
        // The comparison needs the camera or a relative position. Otherwise the level follows the radio, whose slow
        // error is not in the filter's covariance.
        let by_relative_s = self
            .relative
            .state(at)
            .map_or(f64::INFINITY, |r| r.stands_in_age_s());
        let sees = by_relative_s.min(self.age_s(at, &CAMERA)) < self.config.fresh_s;
        let [_, _, height, ..] = measurement::innovations(&axes, &modes, lever_arm, &o);
        if let Some(innovation) = height.filter(|_| sees) {
            self.height.take(at, axes[2].normalised(&innovation));
        }
        self.fuse(&o)
    }

    /// Applies the predecessor's checkpoint once the radio gives the deck's position, unless the deck is detected
    /// first.
    fn begin(&mut self, now: DroneTime, input: &PredictorIn) {
        let sees = self.fused_at(&CAMERA).is_some();
        let Some(succession) = &mut self.succession else {
            return;
        };
        succession.receive(input.plan.as_ref(), input.mission.as_ref());
        if succession.is_read
            || !succession
                .recovery
                .poll(now, self.boot, input.checkpoint.as_ref())
        {
            return;
        }
        let Some(m) = succession.recovery.checkpoint().filter(|_| !sees) else {
            succession.is_read = true;
            return;
        };
        let (Some(drone), Some(filter), Some((vessel_boot, _))) =
            (self.track.newest(), self.filter.as_mut(), self.radio_sequence)
        else {
            return;
        };
        succession.is_read = true;
        if checkpoint::is_valid(now, drone, vessel_boot, &m) {
            let noise = AxisNoise::all(&self.config);
            filter.resume(&m, &checkpoint::variances(now, &noise, &m));
        }
    }

    /// Forecast to publish; a successor's first one must agree with what it inherits.
    fn led(&mut self, now: DroneTime) -> Option<DeckForecast> {
        if self.succession.as_ref().is_some_and(|s| !s.is_read) {
            return None;
        }
        let forecast = self.forecast(now)?;
        if self
            .succession
            .as_ref()
            .is_some_and(|s| !s.agrees(now, &forecast, &self.config))
        {
            return None;
        }
        self.succession = None;
        Some(forecast)
    }

    /// Checkpoint of the newest observation, published with the forecast that has this header.
    fn checkpoint(&self, forecast: &Header<DroneClock>) -> Option<PredictorCheckpoint> {
        let drone = self.track.newest()?;
        let filter = self.filter.as_ref()?;
        let axes = filter.last()?;
        let offset: [(f64, f64); AXES] = core::array::from_fn(|i| axes[i].project(MeasurementRow::Offset));
        Some(PredictorCheckpoint {
            header: Header {
                vessel: drone.header.vessel,
                drone: drone.header.drone,
                at: filter.newest()?,
                ..*forecast
            },
            vessel_boot: self.radio_sequence?.0,
            vision_at: self.fused_at(&CAMERA)?,
            tag_at: self.fused_at(&[Tag]),
            offset: offset.map(|(value, _)| value),
            offset_sd: offset.map(|(_, variance)| variance.sqrt()),
            datum: drone.datum,
            datum_offset: drone.datum_offset,
            heading_jumps: drone.heading_jumps,
            position: drone.position,
            velocity: drone.velocity,
            odometry_at: drone.header.at,
        })
    }

    fn count(&mut self, admitted: Result<(), RejectionReason>) {
        if let Err(reason) = admitted {
            self.rejections.count(reason);
        }
    }

    fn receive(&mut self, now: DroneTime, input: &PredictorIn) {
        if let Some(l) = &input.link {
            let admitted = Self::admit(now, l);
            if admitted.is_ok() && l.clock_offset_sd_s.is_finite() {
                self.clock_sd_s = l.clock_offset_sd_s.min(1.0);
            }
            self.count(admitted);
        }
        if let Some(d) = &input.drone {
            let admitted = self.drone(now, d);
            self.count(admitted);
        }
        let vision_suffices = self.age_s(now, &[Tag]) < self.config.radio_after_vision_s;
        let c = &self.config;
        let modes_age_s = self.waves.newest().map_or(0.0, |at| (now - at).secs());
        let rolled_s = self.waves.reach_s().max(c.fresh_s);
        if let Some(f) = self.filter.as_mut().filter(|_| modes_age_s > rolled_s) {
            f.hold_modes(&mut self.waves);
        }
        let use_wave_model = c.use_wave_model;
        if let Some(p) = &input.prediction {
            let admitted = Self::admit(now, p);
            if admitted.is_ok() {
                self.waves.receive_prediction(p);
            }
            self.count(admitted);
        }
        if let Some(m) = &input.surroundings {
            let admitted = Self::admit(now, m);
            if admitted.is_ok() {
                // Obstacles stay valid until new ones are reported.
                self.surroundings = m.surroundings;
            }
            self.count(admitted);
        }
        if let Some(w) = input.wave.as_ref().filter(|_| use_wave_model) {
            let admitted = self.wave(now, w);
            self.count(admitted);
        }
        self.receive_beacons(now, input);
        if let Some(e) = input.estimate.as_ref().filter(|_| !vision_suffices) {
            let admitted = self.estimate(now, e);
            self.count(admitted);
        }
    }

    /// Identifies the vessel's motion on the drone while the radio is silent. Until then the last received modes are
    /// kept.
    fn identify(&mut self, now: DroneTime) {
        if self.age_s(now, &[Estimate]) <= self.config.fresh_s {
            self.own = None;
            return;
        }
        let own = self.own.get_or_insert_with(|| OwnModel::new(&self.config));
        let newer = own.step(now, self.waves.lever_arm());
        let reach_s = self.waves.reach_s().max(self.config.fresh_s);
        let ours = newer && self.slopes.is_none_or(|(at, _)| (now - at).secs() > reach_s);
        if ours && let Some((at, identified)) = own.publish(&mut self.waves) {
            self.follow_modes(at, identified);
        }
    }

    fn source(&self, radio_age_s: f64, vision_age_s: f64) -> Source {
        let fresh = |age_s: f64| age_s < self.config.fresh_s;
        match (fresh(radio_age_s), fresh(vision_age_s)) {
            (true, true) => Source::Both,
            (true, false) => Source::Radio,
            (false, true) => Source::Vision,
            (false, false) => Source::None,
        }
    }

    fn diverged(&mut self) {
        self.rejections.count(RejectionReason::Diverged);
        self.filter = None;
    }

    fn forecast(&mut self, now: DroneTime) -> Option<DeckForecast> {
        let [radio_age_s, vision_age_s] = [self.age_s(now, &[Estimate]), self.age_s(now, &CAMERA)];
        let unknown = !(radio_age_s.min(vision_age_s) < self.config.silence_s);
        if unknown || radio_age_s.min(vision_age_s) > SILENT_S && self.known_by_beacon(now).is_some() {
            let ages = [radio_age_s, vision_age_s];
            return (self.forecast_by_beacon(now, ages)).or_else(|| self.no_forecast(now, ages));
        }
        if let Some(f) = &mut self.filter {
            f.set_radio_available(radio_age_s < self.config.fresh_s);
        }
        if !self.filter.as_ref()?.is_finite() {
            self.diverged();
            return None;
        }
        let filter = self.filter.as_ref()?;
        let oscillators = self.waves.oscillators(now);
        self.horizon.refresh(&oscillators);
        let axes = filter.at(&self.waves, now);
        let source = self.source(radio_age_s, vision_age_s);
        self.remember(now, &axes, source);
        let filter = self.filter.as_ref()?;
        let common = self.common(&axes, source);
        let clock_var = match source {
            Source::Radio | Source::Both => self.clock_sd_s.powi(2),
            // The error of vision does not depend on the clock offset.
            Source::Vision | Source::None => 0.0,
        };
        let stages = self.horizon.stages(
            &axes,
            &filter.noise(&axes),
            &common,
            clock_var,
            (&self.waves, now),
        );
        let mean_z = self.level.follow(now, &stages);
        if let Some((own, deck)) = self.own.as_mut().zip(stages.first())
            && vision_age_s < self.config.fresh_s
        {
            own.watch(now, deck);
        }
        let predicted_slopes = if self.waves.are_identified() {
            self.far.refresh(&oscillators);
            self.far.slopes(&axes, &filter.noise(&axes), (&self.waves, now))
        } else {
            Seq::new()
        };
        let header = Header::new(0, 0, self.boot, self.sequence, now);
        self.sequence = self.sequence.wrapping_add(1);
        let f = DeckForecast {
            header,
            step: Span::from_secs(self.config.stage_s),
            source,
            radio_age_s,
            vision_age_s,
            tag_age_s: self.age_s(now, &[Tag]),
            beacon: self.known_by_beacon(now).map(|b| [b.sd_m, b.age_s]),
            relative: self.relative.state(now),
            decks_in_sight: self.decks.undecided(now),
            height_nis: self.height.value(now),
            place_apart_m: self.place_apart_m(now, filter, [radio_age_s, vision_age_s]),
            wave_confidence: self.waves.confidence,
            mean_heading: wrap_angle(axes[5].x[MEAN] + axes[5].x[VISION]),
            mean_heading_rate: axes[5].x[RATE],
            mean_z,
            stages,
            slopes: match (self.slopes, &self.own) {
                (Some((at, slopes)), _) if now - at < topics::BRIDGE_WAVE.stale_after => slopes,
                (_, Some(own)) if radio_age_s > SILENT_S => own.slopes(now),
                (Some(_) | None, _) => Seq::new(),
            },
            surroundings: self.surroundings,
            predicted_slopes,
        };
        if f.check().is_err() {
            self.diverged();
            return None;
        }
        Some(f)
    }

    /// Variances of correlated errors that the filter treats as independent: the vessel's own filtered errors, and the
    /// camera mount's error times the distance.
    fn common(&self, axes: &[Axis; AXES], source: Source) -> [(f64, f64); AXES] {
        let vision = match source {
            Source::Both | Source::Vision => true,
            Source::Radio | Source::None => false,
        };
        let k = self.config.radio_floor;
        let lever_arm = self.track.newest().map_or(Vector3::zeros(), |d| {
            Vector3::from_fn(|i, _| axes[i].project(MeasurementRow::Vision).0) - d.position()
        });
        let turn = |i: usize| axes[i].p[VISION][VISION].max(0.0);
        // The scale error of a detection lies along the line of sight.
        let mount = |i: usize| {
            self.config.camera_mount_sd_m.powi(2) + (self.config.vision_scale_sd * lever_arm[i]).powi(2)
        };
        core::array::from_fn(|i| {
            let (v, r) = self.stated[i];
            match i {
                0 | 1 if vision => (mount(i), k * r),
                2 if vision => (
                    turn(3) * lever_arm.y * lever_arm.y + turn(4) * lever_arm.x * lever_arm.x + mount(i),
                    k * r,
                ),
                5 if vision => (0.0, k * r),
                _ => (k * v, k * r),
            }
        })
    }
}

impl Node for Predictor {
    type Clock = DroneClock;
    type In = PredictorIn;
    type Out = PredictorOut;

    fn step(&mut self, now: DroneTime, input: &PredictorIn) -> PredictorOut {
        self.receive(now, input);
        self.measure(now, input);
        self.identify(now);
        self.begin(now, input);
        let period = Span::from_secs(1.0 / self.config.rate_hz);
        let due = self.next.is_due(now, period);
        let forecast = if due { self.led(now) } else { None };
        PredictorOut {
            checkpoint: forecast.as_ref().and_then(|f| self.checkpoint(&f.header)),
            forecast,
        }
    }
}
