use alight_shared::config;

config! {
    /// Timeouts of deck ownership, and digital inputs of the deck.
    pub struct DeckConfig {
        /// Silence after which a descending drone counts as standing on the deck, s. A drone that does not
        /// own the deck is forgotten after this time.
        /// Source: above the longest descent and flare (30 and 8 s), possibly completed without a radio.
        pub status_timeout_s: f64 = 60.0, in 40.0..=3600.0;
        /// Time after which an owner that does not descend gives way to another drone that requests the deck, s.
        /// Source: two calm intervals between groups of swell.
        pub idle_timeout_s: f64 = 30.0, in 1.0..=3600.0;
        /// Time after a start during which no drone receives the deck, s, so that its former owner reports first.
        /// Source: six periods of a drone's status.
        pub startup_hold_s: f64 = 3.0, in 1.0..=60.0;
        /// Digital input of the crew's switch, 1 while it closes the deck: a line (`/dev/gpiochip0:17`, with
        /// `:active-low` if it is pulled up) or a file that holds 0 or 1; empty: none. An unreadable input counts as 1.
        pub crew_switch: String = String::new();
        /// Digital input of a sensor for objects on the deck, 1 while occupied: a line or a file; empty: none. An
        /// unreadable input counts as 1.
        pub occupancy_sensor: String = String::new();
        /// Digital input of the helm's switch, 1 while the vessel turns or may turn, 0 while it keeps course and speed:
        /// a line or a file; empty: none. An unreadable input counts as 1.
        pub helm_switch: String = String::new();
        /// Time for which the helm keeps course and speed after its switch was last at 0, s.
        /// Chosen: twice the longest descent.
        pub helm_steady_s: f64 = 60.0, in 1.0..=3600.0;
        /// Digital output of the helm's lamp, 1 while a drone asks for a steady course: a line or a file;
        /// empty: none.
        pub helm_lamp: String = String::new();
    }
}
