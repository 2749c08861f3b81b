//! An episode of collected data.

use config::Collect;
use maze::{Layout, Route, SUCCESS_RADIUS, Style, random_task};
use rand::RngExt;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use simulator::Simulator;

use crate::drive::Drive;

/// Waypoints lie up to this far off the centre of their cell in each axis (m).
const OFF_CENTRE: f32 = 1.0;

/// Rows of an episode, flat.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Episode {
    pub(super) observations: Vec<f32>,
    pub(super) actions: Vec<f32>,
    pub(super) goals: Vec<f32>,
    /// Observation after each action.
    pub(super) next: Vec<f32>,
}

/// The way to a goal, along waypoints that are off their cells' centres.
struct Way<'a> {
    layout: &'a Layout,
    style: Style,
    route: Route,
    waypoint: [f32; 2],
    offset: [f32; 2],
}

impl Way<'_> {
    /// The direction to move in from a place (m). At the goal another one is drawn.
    fn direction(&mut self, place: [f32; 2], rng: &mut Pcg64Mcg) -> [f32; 2] {
        let goal = self.route.goal();
        if (goal[0] - place[0]).hypot(goal[1] - place[1]) < SUCCESS_RADIUS {
            let task = random_task(self.layout, self.style, rng);
            self.route = Route::new(self.layout, task.goal, task.goal_cell);
        }
        let towards = self.route.waypoint(self.layout, place);
        if towards != self.waypoint {
            self.waypoint = towards;
            let last = towards == self.route.goal();
            self.offset = [0; 2].map(|_| match last {
                true => 0.0,
                false => rng.random_range(-OFF_CENTRE..OFF_CENTRE),
            });
        }
        [0, 1].map(|axis| self.waypoint[axis] + self.offset[axis] - place[axis])
    }
}

/// Plays the episode of a random stream. None if the simulator observes no floats, which nobody drives by.
pub(super) fn play(
    simulator: &mut dyn Simulator,
    drive: &mut Drive,
    layout: &Layout,
    settings: &Collect,
    mut rng: Pcg64Mcg,
) -> Option<Episode> {
    let style = if settings.style == "play" {
        Style::Play
    } else {
        Style::Diverse
    };
    let task = random_task(layout, style, &mut rng);
    let mut way = Way {
        layout,
        style,
        route: Route::new(layout, task.goal, task.goal_cell),
        waypoint: [f32::NAN; 2],
        offset: [0.0; 2],
    };
    simulator.reset(&task.into(), &mut rng);
    let body = simulator.body();
    let mut episode = Episode::default();
    let noise = Normal::new(0.0, settings.noise as f32).ok();
    let mut action = vec![];
    for _ in 0..=settings.episode_steps {
        let observation = simulator.observation().floats()?;
        let direction = way.direction(body.place(observation), &mut rng);
        drive.act(observation, direction, &mut action);
        for value in &mut action {
            let noise = noise.map_or(0.0, |noise| noise.sample(&mut rng));
            *value = (*value + noise).clamp(-1.0, 1.0);
        }
        episode.observations.extend_from_slice(observation);
        episode.actions.extend_from_slice(&action);
        episode.goals.extend(way.route.goal());
        simulator.step(&action);
        let next = simulator.observation().floats()?;
        episode.next.extend_from_slice(next);
    }
    Some(episode)
}

#[cfg(test)]
mod tests {
    use agents::stream;

    use super::*;

    #[test]
    fn the_point_reaches_goals_and_its_seed_alone_decides_where() {
        let text = "[maze]\nlayout = \"medium\"\n[dataset]\npath = \"x.hdf5\"\n[collect]\n\
                    episode_steps = 700\n";
        let config = agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap();
        let settings = config.collect.as_ref().unwrap();
        let layout = crate::layout(&config).unwrap();
        let mut simulator = simulators::create("point", &layout, SUCCESS_RADIUS).unwrap();
        let mut drive = Drive::of("point", None).unwrap();
        let mut episode = |seed| {
            play(
                &mut *simulator,
                &mut drive,
                &layout,
                settings,
                stream(seed, "collect", 0),
            )
            .unwrap()
        };
        let first = episode(1);
        assert_eq!(
            (first.observations.len(), first.actions.len()),
            (701 * 4, 701 * 2)
        );
        assert!(first.actions.iter().all(|value| value.abs() <= 1.0));
        // A goal that is reached gives way to another one.
        let mut goals: Vec<&[f32]> = first.goals.chunks(2).collect();
        goals.dedup();
        assert!(goals.len() > 3, "{} goals", goals.len());
        assert!(episode(2) != first && episode(1) == first);
    }
}
