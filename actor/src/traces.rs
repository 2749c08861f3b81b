//! Which episodes leave a trace, and what is recorded of them.

use std::collections::BTreeMap;
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use agents::{GRAPH, Plan, Policy, Versions};
use config::Config;
use maze::{Layout, WALL_HEIGHT};
use simulator::{Body, Simulator, Task};
use trace::{
    Behind, ChoiceRecord, EndRecord, Episode, EpisodeMeta, OutcomeRecord, Recorder, Scene,
    StateRecord, StepRecord, Still,
};

use crate::episode::{Environment, Purpose};

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
    body: &'static dyn Body,
    /// Names of the algorithm's networks.
    networks: Vec<&'static str>,
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
        plan: &dyn Plan,
        layout: &'a Layout,
        folder: &Path,
        actor: u32,
    ) -> std::io::Result<Self> {
        let settings = &config.traces;
        let wanted = config.offline && (settings.evaluation || settings.training_every > 0);
        let body = agents::body(config);
        let warn = |message: &str| log::warn!("{message}");
        let recorder = wanted.then(|| Recorder::new(&body.spaces(), warn));
        let recorder = recorder.transpose()?;
        let networks = plan.networks().into_iter().map(|network| network.name);
        Ok(Self {
            config,
            body,
            networks: networks.collect(),
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
        purpose: Purpose,
        task: &Task,
        simulator: &dyn Simulator,
        policy: &dyn Policy,
        versions: &Versions,
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
            purpose: purpose.name().to_owned(),
            actor: self.actor,
            episode_index: match numbered {
                Numbered::Evaluation(episode) | Numbered::Round(_, episode) => episode.into(),
                Numbered::Own(episode) => episode,
            },
            seed: config.run.seed,
            maze: config.maze.layout.clone(),
            start: task.start,
            goal: [0, 1].map(|axis| task.goal.get(axis).copied().unwrap_or(f32::NAN)),
            simulator: self.body.name().to_owned(),
            spaces: Some(self.body.spaces()),
            versions: self.named(policy, versions),
            success_radius: config.evaluation.success_radius as f32,
        };
        let still = self.still(versions[GRAPH], policy);
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
                state: simulator.state(),
            };
            recorder.begin(episode, behind);
        }
    }

    /// Versions of the networks, and of the graph where there is one.
    fn named(&self, policy: &dyn Policy, versions: &Versions) -> BTreeMap<String, u64> {
        let networks = self.networks.iter().zip(versions);
        let graph = policy.graph().map(|_| ("graph", versions[GRAPH]));
        let named = networks.map(|(name, version)| (*name, *version));
        let named = named.chain(graph);
        named
            .map(|(name, version)| (name.to_owned(), version))
            .collect()
    }

    /// The world with a graph, made anew for a new graph alone.
    fn still(&mut self, graph_version: u64, policy: &dyn Policy) -> Arc<Still> {
        if let Some((_, still)) = self.still.as_ref().filter(|(v, _)| *v == graph_version) {
            return Arc::clone(still);
        }
        let (nodes, edges) = policy.graph().map_or_else(Default::default, |graph| {
            (graph.places.clone(), graph.pairs())
        });
        let scene = Scene {
            walls: self.layout.boxes(),
            wall_height: WALL_HEIGHT,
            nodes,
            edges,
            ..Scene::default()
        };
        let still = Arc::new(Still::new(scene.with_body(self.body)));
        self.still = Some((graph_version, Arc::clone(&still)));
        still
    }

    fn recorder(&mut self) -> Option<&mut Recorder> {
        self.recorder.as_mut().filter(|recorder| recorder.is_open())
    }

    /// Records what was decided before an action, and gives the step's record, whose reward is still
    /// to come; none where no trace is open.
    pub(crate) fn decided(
        &mut self,
        environment: &Environment,
        policy: &mut dyn Policy,
    ) -> Option<StepRecord> {
        let recorder = self.recorder()?;
        let act = &environment.act;
        let step = environment.tally.steps as u32;
        let number = |node: Option<u32>| node.map_or(-1, |node| node as i32);
        if let Some(outcome) = act.outcome {
            recorder.outcome(OutcomeRecord {
                step,
                node: outcome.from as i32,
                subgoal_node: outcome.to as i32,
                reached: outcome.reached,
            });
        }
        if act.chosen {
            let choosing = policy.choosing();
            let (neighbours, probabilities) = choosing.probabilities.into_iter().collect();
            recorder.choice(ChoiceRecord {
                step,
                node: number(act.node),
                goal_node: number(act.goal_node),
                subgoal_node: number(act.subgoal),
                value: choosing.value,
                neighbours,
                probabilities,
            });
        }
        let mut record = recorder.blank();
        record.step = step;
        record.state.observe(&*environment.simulator);
        record.action.extend_from_slice(&act.action);
        record.node = number(act.node);
        record.subgoal_node = number(act.subgoal);
        record.subgoal = act.target;
        Some(record)
    }

    /// Records a step.
    pub(crate) fn step(&mut self, mut record: StepRecord, reward: f32) {
        record.reward = reward;
        if let Some(recorder) = self.recorder() {
            recorder.step(record);
        }
    }

    /// Ends the trace that is open.
    pub(crate) fn end(&mut self, success: bool, fell: bool, simulator: &dyn Simulator) {
        if let Some(recorder) = self.recorder() {
            let state = StateRecord::of(simulator);
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
