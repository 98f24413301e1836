//! How fast the needle robot feeds the needle.

use sonoloop_types::TICKS_PER_SECOND;

/// Feed of the needle robot: depth and speed along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Feed {
    pub depth_m: f64,
    pub speed_m_s: f64,
    /// Speed last asked for, already 0 when the robot stopped by itself.
    pub wanted_m_s: f64,
}

/// What the feed keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FeedLimits {
    pub max_feed_m_s: f64,
    pub max_acceleration_m_s2: f64,
    pub max_depth_m: f64,
}

impl Feed {
    pub(crate) fn at_rest(depth_m: f64) -> Self {
        Self { depth_m, speed_m_s: 0.0, wanted_m_s: 0.0 }
    }

    /// One tick: the speed follows the wanted one within acceleration and speed limits, and comes to rest
    /// at the largest depth at the latest.
    pub(crate) fn step(&mut self, limits: &FeedLimits) {
        let FeedLimits { max_feed_m_s, max_acceleration_m_s2, max_depth_m } = *limits;
        let dt_s = 1.0 / TICKS_PER_SECOND as f64;
        let change = max_acceleration_m_s2 * dt_s;
        let room_m = (max_depth_m - self.depth_m).max(0.0);
        // Discrete stopping: at speed n·change the needle still travels n²·change·dt/2, since each tick
        // moves by the mean of its two speeds. One `change` of reserve covers the tick in progress.
        let stoppable_m_s = ((2.0 * max_acceleration_m_s2 * room_m).sqrt() - change).max(0.0);
        let wanted = self.wanted_m_s.clamp(0.0, max_feed_m_s).min(stoppable_m_s);
        let next = wanted.clamp((self.speed_m_s - change).max(0.0), self.speed_m_s + change);
        let travel_m = 0.5 * (self.speed_m_s + next) * dt_s;
        self.speed_m_s = next;
        self.depth_m = (self.depth_m + travel_m).min(max_depth_m.max(self.depth_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> FeedLimits {
        FeedLimits { max_feed_m_s: 0.02, max_acceleration_m_s2: 0.1, max_depth_m: 0.05 }
    }

    #[test]
    fn feed_keeps_its_limits_and_stops_at_the_end_of_its_travel() {
        let robot = limits();
        let mut feed = Feed::at_rest(0.01);
        feed.wanted_m_s = 1.0;
        let max_depth_m = robot.max_depth_m;
        for _ in 0..20_000 {
            let before = feed;
            feed.step(&robot);
            assert!(feed.speed_m_s <= robot.max_feed_m_s + 1e-15 && feed.speed_m_s >= 0.0);
            let acceleration = (feed.speed_m_s - before.speed_m_s).abs() * 1e3;
            assert!(acceleration <= robot.max_acceleration_m_s2 * (1.0 + 1e-9));
            assert!(feed.depth_m >= before.depth_m && feed.depth_m <= max_depth_m);
        }
        assert!(max_depth_m - feed.depth_m < 1e-5, "{}", max_depth_m - feed.depth_m);
    }

    #[test]
    fn truth_stopping_distance_is_v_squared_over_two_a() {
        let robot = limits();
        let mut feed = Feed { depth_m: 0.0, speed_m_s: 0.01, wanted_m_s: 0.0 };
        for _ in 0..1000 {
            feed.step(&robot);
        }
        let expected = 0.01 * 0.01 / (2.0 * robot.max_acceleration_m_s2);
        assert!((feed.depth_m - expected).abs() < 1e-9 && feed.speed_m_s == 0.0);
    }
}
