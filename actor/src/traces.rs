//! Which episodes leave a trace, and what is told of them.

use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use agents::navigator::{Decision, Navigator};
use config::Config;
use maze::{
    AntBody, AntMaze, AntSimulator, Layout, Observation, Start, Task, WALL_HEIGHT, upright,
};
use simulator::Body;
use trace::{
    Behind, ChoiceRecord, EndRecord, Episode, EpisodeMeta, OutcomeRecord, Recorder, Scene,
    StateRecord, StepRecord, Still,
};

use crate::inbox::Versions;

/// An episode by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Numbered {
    /// Of the evaluation.
    Evaluation(u32),
    /// Of a round.
    Round(u32, u32),
    /// Of this process.
    Own(u64),
}

/// The traces of an actor.
pub(crate) struct Traces<'a> {
    config: &'a Config,
    layout: &'a Layout,
    folder: PathBuf,
    actor: u32,
    /// None where no episode leaves a trace.
    recorder: Option<Recorder>,
    /// The world with the graph of a version.
    still: Option<(u64, Arc<Still>)>,
}

impl<'a> Traces<'a> {
    pub(crate) fn new(
        config: &'a Config,
        layout: &'a Layout,
        folder: &Path,
        actor: u32,
    ) -> std::io::Result<Self> {
        let settings = &config.traces;
        let wanted = settings.evaluation || settings.training_every > 0;
        let warn = |told: &str| log::warn!("{told}");
        let recorder = wanted.then(|| Recorder::new(&AntBody.spaces(), warn));
        let recorder = recorder.transpose()?;
        Ok(Self {
            config,
            layout,
            folder: folder.join("traces"),
            actor,
            recorder,
            still: None,
        })
    }

    fn is_wanted(&self, numbered: Numbered) -> bool {
        let every = self.config.traces.training_every as u64;
        let number = match numbered {
            Numbered::Evaluation(_) => return self.config.traces.evaluation,
            Numbered::Round(round, episode) => {
                let before = u64::from(round.saturating_sub(1));
                before * self.config.rollouts.episodes as u64 + u64::from(episode) + 1
            }
            Numbered::Own(episode) => episode,
        };
        every > 0 && number.is_multiple_of(every)
    }

    /// Where the trace goes, and what it is called until it is whole: two actors may play the same
    /// episode at a time.
    fn paths(&self, numbered: Numbered) -> [PathBuf; 2] {
        let training = self.folder.join("training");
        let (folder, name) = match numbered {
            Numbered::Evaluation(episode) => (&self.folder, format!("episode-{episode:04}")),
            Numbered::Round(round, episode) => {
                (&training, format!("round-{round:03}-{episode:04}"))
            }
            Numbered::Own(episode) => {
                let (actor, process) = (self.actor, wire::incarnation());
                (
                    &training,
                    format!("actor-{actor}-{process:08x}-{episode:06}"),
                )
            }
        };
        let actor = self.actor;
        [
            folder.join(format!("{name}.mcap")),
            folder.join(format!("{name}.actor-{actor}.mcap.part")),
        ]
    }

    /// Begins the trace of an episode that is to leave one.
    pub(crate) fn begin(
        &mut self,
        numbered: Numbered,
        purpose: &str,
        task: &Task,
        start: &Start,
        navigator: &Navigator,
        versions: Versions,
    ) {
        if !self.is_wanted(numbered) {
            return;
        }
        let [path, part] = self.paths(numbered);
        if let Some(folder) = path.parent() {
            // Where it fails, the recorder says why.
            let _ = DirBuilder::new().recursive(true).mode(0o700).create(folder);
        }
        let config = self.config;
        let meta = EpisodeMeta {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            run: config.run.name.clone(),
            config_hash: config.hash(),
            config_toml: config.resolved().to_owned(),
            purpose: purpose.to_owned(),
            actor: self.actor,
            episode_index: match numbered {
                Numbered::Evaluation(episode) | Numbered::Round(_, episode) => episode.into(),
                Numbered::Own(episode) => episode,
            },
            seed: config.run.seed,
            maze: config.maze.layout.clone(),
            start: task.start,
            goal: task.goal,
            simulator: AntBody.name().to_owned(),
            spaces: Some(AntBody.spaces()),
            versions: ["low", "high", "graph"]
                .map(str::to_owned)
                .into_iter()
                .zip(versions)
                .collect(),
            success_radius: config.evaluation.success_radius as f32,
        };
        let still = self.still(versions[2], navigator);
        let behind = match numbered {
            Numbered::Evaluation(_) => Behind::Wait,
            Numbered::Round(..) | Numbered::Own(_) => Behind::Skip,
        };
        if let Some(recorder) = &mut self.recorder {
            let episode = Episode {
                path,
                part,
                meta,
                still,
                state: Some(AntSimulator::state_of(start, task.goal)),
            };
            recorder.begin(episode, behind);
        }
    }

    /// The world with a graph, made anew for a new graph alone.
    fn still(&mut self, graph_version: u64, navigator: &Navigator) -> Arc<Still> {
        if let Some((_, still)) = self.still.as_ref().filter(|(v, _)| *v == graph_version) {
            return Arc::clone(still);
        }
        let graph = navigator.graph();
        let scene = Scene {
            walls: self.layout.boxes(),
            wall_height: WALL_HEIGHT,
            nodes: graph.places.clone(),
            edges: graph.pairs(),
            ..Scene::default()
        };
        let still = Arc::new(Still::new(scene.with_body(&AntBody)));
        self.still = Some((graph_version, Arc::clone(&still)));
        still
    }

    fn recorder(&mut self) -> Option<&mut Recorder> {
        self.recorder.as_mut().filter(|recorder| recorder.is_open())
    }

    /// Tells what was decided before an action, and gives the step's record, whose reward is still
    /// to come; none where no trace is open.
    pub(crate) fn decided(
        &mut self,
        step: usize,
        observation: &Observation,
        decision: &Decision,
        navigator: &mut Navigator,
        ant: &AntMaze,
    ) -> Option<StepRecord> {
        let recorder = self.recorder()?;
        let step = step as u32;
        let subgoal_node = decision.subgoal.map_or(-1, |node| node as i32);
        if let Some(outcome) = decision.outcome {
            recorder.outcome(OutcomeRecord {
                step,
                node: outcome.from as i32,
                subgoal_node: outcome.to as i32,
                reached: outcome.reached,
            });
        }
        if decision.chosen.is_some() {
            let (neighbours, probabilities) = navigator.probabilities().iter().copied().collect();
            recorder.choice(ChoiceRecord {
                step,
                node: decision.node as i32,
                goal_node: navigator.goal_node() as i32,
                subgoal_node,
                value: navigator.value(decision.node),
                neighbours,
                probabilities,
            });
        }
        let mut record = recorder.blank();
        record.step = step;
        state_of(observation, ant, &mut record.state);
        record.action.extend(decision.action);
        record.node = decision.node as i32;
        record.subgoal_node = subgoal_node;
        record.subgoal = Some(decision.place);
        Some(record)
    }

    /// Tells a step.
    pub(crate) fn step(&mut self, record: StepRecord) {
        if let Some(recorder) = self.recorder() {
            recorder.step(record);
        }
    }

    /// Ends the trace that is open.
    pub(crate) fn end(&mut self, success: bool, observation: &Observation, ant: &AntMaze) {
        if let Some(recorder) = self.recorder() {
            let mut state = StateRecord::default();
            state_of(observation, ant, &mut state);
            let fell = upright(observation) < maze::FALLEN;
            recorder.end(EndRecord {
                state,
                success,
                fell,
            });
        }
    }

    /// Gives the trace up that is open.
    pub(crate) fn discard(&mut self) {
        if let Some(recorder) = self.recorder() {
            recorder.discard();
        }
    }
}

fn state_of(observation: &Observation, ant: &AntMaze, state: &mut StateRecord) {
    state.observation.extend(observation);
    state.poses.extend(ant.body_poses());
}
