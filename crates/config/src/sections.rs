//! The tables that every run has, and what their keys mean; defaults and ranges stand in `read`.

use crate::key::Key;
use crate::settings::Settings;

/// `[run]`
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Names the run's folder; the file's name by default.
    pub name: String,
    /// Seed of every random generator.
    pub seed: u64,
    /// What is trained: the name of an algorithm.
    pub algorithm: String,
    /// What is trained on: the name of a simulator.
    pub simulator: String,
    /// Whether the same config gives the same result: rollouts in rounds instead of all the time.
    pub deterministic: bool,
    /// Time between two states that a killed process or a resumed run goes on from (s).
    pub checkpoint_seconds: f64,
}

/// `[maze]`
#[derive(Debug, Clone, PartialEq)]
pub struct Maze {
    /// `umaze`, `medium`, `large`, `giant`, `teleport`, or `custom` with rows.
    pub layout: String,
    /// Rows of 1 (wall), 0 (free), r (start), g (goal), i and o (teleport in and out).
    pub rows: Vec<String>,
}

/// `[topology]`
#[derive(Debug, Clone, PartialEq)]
pub struct Topology {
    /// Actor processes that the launcher starts.
    pub actors: usize,
    /// Actors at a time, attached ones included.
    pub max_actors: usize,
    /// Trajectories that an actor may have unacknowledged.
    pub window: usize,
    /// Trajectories of weights that are more versions old than this are not learned from; a
    /// version is one update of the high level, or of the walker.
    pub max_policy_lag: usize,
}

/// `[actor]`, `[learner]`, `[graph_builder]`: how a role's processes are watched.
#[derive(Debug, Clone, PartialEq)]
pub struct Supervision {
    /// Restarts within the window before a process is given up.
    pub restarts: usize,
    /// See `restarts` (s).
    pub window_seconds: f64,
    /// Pause before the first restart (s); it doubles with every further one in the window.
    pub pause_seconds: f64,
    /// The longest pause (s).
    pub longest_pause_seconds: f64,
    /// A process that said nothing for so long hangs, and is killed and started again (s).
    pub hung_seconds: f64,
    /// The same for one that was never heard (s).
    pub start_seconds: f64,
    /// And for one that has work and does not get on with it (s).
    pub stuck_seconds: f64,
}

/// `[collect]`
#[derive(Debug, Clone, PartialEq)]
pub struct Collect {
    /// `diverse` (random starts and goals) or `play` (hand-picked goals).
    pub style: String,
    /// Transitions to write.
    pub transitions: usize,
    /// Control steps of an episode.
    pub episode_steps: usize,
    /// Standard deviation of the noise on actions.
    pub noise: f64,
    /// Weights of the walker; the ones built in when absent.
    pub walker: Option<String>,
    /// Threads that simulate.
    pub threads: usize,
}

/// What becomes of data that do not fit the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misfit {
    /// They are refused.
    Refuse,
    /// They are taken, with a word about it.
    Warn,
}

/// What becomes of a data set in which an episode breaks its format's rules: an array of a wrong
/// length or missing, a value that is not finite, a chunk that cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnFault {
    /// It is refused.
    #[default]
    Refuse,
    /// Such episodes are left out whole, unless they are more than half of all.
    DropEpisode,
}

/// `[dataset]`
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// A D4RL HDF5 file, a Minari folder or an OGBench npz.
    pub path: String,
    /// Cells `[row, column]` of the maze whose rows are left out, as if nobody had been there.
    pub leave_out: Vec<[usize; 2]>,
    /// Whether data that do not fit maze and ant are refused: `refuse`, or `warn` to take them as
    /// they are.
    pub fit: Misfit,
    /// `refuse`, or `drop-episode`.
    pub on_fault: OnFault,
}

impl Dataset {
    /// Whether the rows at a cell are left out; a place outside of the maze has none.
    #[must_use]
    pub fn leaves_out(&self, cell: Option<(usize, usize)>) -> bool {
        cell.is_some_and(|(row, column)| self.leave_out.contains(&[row, column]))
    }
}

/// `[rollouts]`
#[derive(Debug, Clone, PartialEq)]
pub struct Rollouts {
    /// From the moment that all weights are there to the evaluation (s).
    pub seconds: f64,
    /// Every so many episodes of an actor one is a test, by the evaluation's protocol, that
    /// nothing is learned from: the learning curve. Zero is none.
    pub test_every: usize,
    /// Rounds of a deterministic run, each with one version of weights and graph.
    pub rounds: usize,
    /// Episodes of a round.
    pub episodes: usize,
}

/// `[evaluation]`
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Episodes.
    pub episodes: usize,
    /// Control steps of an episode: 700 in umaze, else 1000.
    pub max_steps: usize,
    /// The goal is reached within this distance (m).
    pub success_radius: f64,
}

/// `[traces]`
#[derive(Debug, Clone, PartialEq)]
pub struct Traces {
    /// Whether every episode of the evaluation leaves a trace.
    pub evaluation: bool,
    /// Every so many training episodes of an actor one leaves a trace, unless the thread that writes
    /// is behind. Zero is none.
    pub training_every: usize,
}

/// A whole run file.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// `[run]`
    pub run: Run,
    /// `[maze]`
    pub maze: Maze,
    /// `[topology]`
    pub topology: Topology,
    /// `[actor]`
    pub actor: Supervision,
    /// `[learner]`
    pub learner: Supervision,
    /// `[graph_builder]`
    pub graph_builder: Supervision,
    /// Whether the algorithm learns from a data set, and is scored in an evaluation.
    pub offline: bool,
    /// `[dataset]`
    pub dataset: Dataset,
    /// `[collect]`: makes the data set when its file is not there.
    pub collect: Option<Collect>,
    /// `[rollouts]`
    pub rollouts: Rollouts,
    /// `[evaluation]`
    pub evaluation: Evaluation,
    /// `[traces]`
    pub traces: Traces,
    /// The algorithm's own tables.
    pub settings: Settings,
    pub(crate) resolved: String,
    pub(crate) portable: String,
    pub(crate) keys: Vec<Key>,
}
