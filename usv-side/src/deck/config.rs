//! Parameters of the deck.

use alight_shared::config;

config! {
    /// When the deck changes its owner.
    pub struct DeckConfig {
        /// A drone in descent whose status is older than this counts as standing on the deck; one without the deck
        /// is forgotten, s.
        /// Source: above the longest descent and flare together (30 and 8 s), which a drone may
        /// finish without a radio.
        pub status_timeout_s: f64 = 60.0, in 40.0..=3600.0;
        /// A drone that does not begin to descend for this long gives way to another that requests the deck, s.
        /// Source: two calms between groups of swell.
        pub idle_timeout_s: f64 = 30.0, in 1.0..=3600.0;
        /// After a start the deck is given to no drone for this long, s: its owner before the restart reports first.
        /// Source: six periods of a drone's status.
        pub startup_hold_s: f64 = 3.0, in 1.0..=60.0;
        /// Digital input of the crew's switch, 1 while they close the deck: a line (`/dev/gpiochip0:17`, with
        /// `:active-low` one that is pulled up) or a file that holds 0 or 1; empty: none. Unreadable counts as 1.
        pub crew_switch: String = String::new();
        /// Digital input of a sensor of what lies on the deck, 1 while it is occupied: a line or a file; empty: none.
        /// Unreadable counts as 1.
        pub occupancy_sensor: String = String::new();
        /// Digital input of the helm's switch, 1 while the vessel turns or may turn, 0 while she keeps course and
        /// speed: a line or a file; empty: none. Unreadable counts as 1.
        pub helm_switch: String = String::new();
        /// So long the helm keeps course and speed from any moment on at which its switch is at 0, s.
        /// Chosen: twice the longest descent.
        pub helm_steady_s: f64 = 60.0, in 1.0..=3600.0;
        /// Digital output of the helm's lamp, lit (1) while a drone asks for a steady course: a line or a file; empty: none.
        pub helm_lamp: String = String::new();
    }
}
