//! Every table and key, and what it means; defaults and ranges stand in `read`.

/// What a run is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// LG-H-PPO from offline data, evaluated in the physics.
    Offline,
    /// PPO of a walker, which makes offline data.
    Walker,
}

/// `[run]`
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Names the run's folder; the file's name by default.
    pub name: String,
    /// Seed of every random generator.
    pub seed: u64,
    /// `offline` or `walker`.
    pub kind: Kind,
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

/// What a state's latent is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latent {
    /// A code of the VAE.
    Vae,
    /// The place itself: the oracle of stage 1.
    Place,
}

/// `[encoder]`
#[derive(Debug, Clone, PartialEq)]
pub struct Encoder {
    /// `vae`, or `place`: then a latent has two values and there are no hidden layers.
    pub kind: Latent,
    /// Width of a latent.
    pub latent: usize,
    /// Control steps between the two places of a pair.
    pub lag: usize,
    /// Weight of the KL term.
    pub beta: f64,
    /// Share of the KL gradient that trains the prior.
    pub prior_balance: f64,
    /// Probability that the condition is replaced by the null token.
    pub null_condition: f64,
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Step size.
    pub learning_rate: f64,
    /// Pairs of a gradient step.
    pub batch: usize,
    /// Gradient steps.
    pub updates: usize,
    /// Weights of another run's checkpoint, instead of training.
    pub from: Option<String>,
}

/// How k-means begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seeding {
    /// Far from the centroids found so far.
    PlusPlus,
    /// Anywhere: the paper's ablation.
    Random,
}

/// What of the edges' times and reachability is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Knowledge {
    /// Nothing: every edge is like every other one.
    Nothing,
    /// What the data tell.
    Data,
    /// And what rollouts tell.
    Rollouts,
}

/// `[graph]`
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    /// Number of nodes (K).
    pub nodes: usize,
    /// Control steps of a segment that makes an edge.
    pub lag: usize,
    /// Segments that an edge needs.
    pub min_count: usize,
    /// Trajectories that an edge needs.
    pub min_trajectories: usize,
    /// States of a 0.5 m cell that are clustered, at most.
    pub states_per_place: usize,
    /// Seconds between versions of the graph while rollouts come in.
    pub refresh_seconds: f64,
    /// `k-means++` or `random`.
    pub seeding: Seeding,
    /// Wrong edges added, as a share of the right ones: the paper's ablation.
    pub wrong_edges: f64,
    /// `none`, `data` or `rollouts`.
    pub knowledge: Knowledge,
    /// Whether rollouts add nodes and edges and drop edges that lead nowhere.
    pub online: bool,
    /// Nodes that an online graph may grow to.
    pub max_nodes: usize,
    /// A state this many times farther from every node than the data's states are is at a new
    /// place.
    pub growth_radius: f64,
    /// States at a new place that make a node.
    pub growth_states: usize,
    /// An online graph drops edges that rollouts reach the end of less often than this.
    pub least_success: f64,
}

/// What walks to a subgoal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// The learned low level.
    Learned,
    /// The walker that made the data: the oracle of stage 3a.
    Walker,
}

/// `[low]`
#[derive(Debug, Clone, PartialEq)]
pub struct Low {
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Step size, falling to a tenth over the updates.
    pub learning_rate: f64,
    /// Transitions of a gradient step.
    pub batch: usize,
    /// Gradient steps.
    pub updates: usize,
    /// Expectile of the value.
    pub expectile: f64,
    /// Discount a step.
    pub discount: f64,
    /// 1 / temperature of the advantage weights.
    pub inverse_temperature: f64,
    /// Largest advantage weight.
    pub weight_clip: f64,
    /// Rate of the slow targets.
    pub target_rate: f64,
    /// Share of subgoals that are snapped to their node's centroid.
    pub snap: f64,
    /// Subgoals lie up to the graph's lag plus this many steps ahead.
    pub slack: usize,
    /// `learned` or `walker`.
    pub controller: Controller,
    /// Weights of another run's checkpoint, instead of training.
    pub from: Option<String>,
}

/// What finds the way over the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Planner {
    /// The learned high level.
    Learned,
    /// Dijkstra's search: the paper's ablation, and the oracle of stage 3b.
    Search,
}

/// `[high]`
#[derive(Debug, Clone, PartialEq)]
pub struct High {
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Step size, falling to a tenth over the steps.
    pub learning_rate: f64,
    /// Walks on the graph side by side.
    pub environments: usize,
    /// Edges that each takes between updates.
    pub horizon: usize,
    /// Passes over a batch.
    pub epochs: usize,
    /// Choices of a gradient step.
    pub minibatch: usize,
    /// PPO's clip.
    pub clip: f64,
    /// Weight of the entropy bonus, falling to nothing over the steps.
    pub entropy: f64,
    /// Discount an edge of mean length.
    pub discount: f64,
    /// Lambda of the advantage estimate.
    pub gae_lambda: f64,
    /// Reward on arrival.
    pub arrival_reward: f64,
    /// Cost of an edge of mean length.
    pub edge_cost: f64,
    /// Edges after which a walk is cut off.
    pub max_edges: usize,
    /// Choices on the graph in all.
    pub steps: usize,
    /// Largest share of a batch that comes from rollouts in the physics.
    pub physics_share: f64,
    /// `learned` or `search`.
    pub planner: Planner,
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

/// `[execution]`
#[derive(Debug, Clone, PartialEq)]
pub struct Execution {
    /// A node is reached within this distance of its place (m).
    pub reached_radius: f64,
    /// Within this distance the goal itself is the subgoal (m).
    pub goal_radius: f64,
    /// Nodes that the subgoal lies ahead of the current one, at most.
    pub look_ahead: usize,
    /// An edge is given up after this many times its mean steps.
    pub timeout_factor: f64,
    /// And after this many steps at most.
    pub max_edge_steps: usize,
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

/// `[walker]`
#[derive(Debug, Clone, PartialEq)]
pub struct WalkerTraining {
    /// Ants of each actor.
    pub environments: usize,
    /// Steps of a trajectory.
    pub segment: usize,
    /// Transitions of an update.
    pub batch: usize,
    /// Passes over a batch.
    pub epochs: usize,
    /// Transitions of a gradient step.
    pub minibatch: usize,
    /// Step size, falling to a tenth over the steps.
    pub learning_rate: f64,
    /// PPO's clip.
    pub clip: f64,
    /// Weight of the entropy bonus.
    pub entropy: f64,
    /// Discount a step.
    pub discount: f64,
    /// Lambda of the advantage estimate.
    pub gae_lambda: f64,
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Log standard deviation of actions at the start.
    pub initial_log_std: f64,
    /// Epochs end early beyond this divergence.
    pub target_kl: f64,
    /// Control steps in all.
    pub steps: usize,
    /// Mean control steps between changes of direction.
    pub turn_every: f64,
    /// Share of ants that walk shortest paths in the maze instead of the open floor.
    pub maze_share: f64,
    /// Walking faster than this earns no more (m/s).
    pub top_speed: f64,
    /// What a fall costs.
    pub fall_cost: f64,
    /// What a step costs on the side (a tilt of 90 degrees); upright it is free.
    pub tilt_cost: f64,
    /// Weights to start from; fresh ones when empty.
    pub start: String,
    /// File that the trained walker is written to; empty for the run's folder alone.
    pub output: String,
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
    /// `[dataset]`
    pub dataset: Dataset,
    /// `[collect]`: makes the data set when its file is not there.
    pub collect: Option<Collect>,
    /// `[encoder]`
    pub encoder: Encoder,
    /// `[graph]`
    pub graph: Graph,
    /// `[low]`
    pub low: Low,
    /// `[high]`
    pub high: High,
    /// `[rollouts]`
    pub rollouts: Rollouts,
    /// `[execution]`
    pub execution: Execution,
    /// `[evaluation]`
    pub evaluation: Evaluation,
    /// `[traces]`
    pub traces: Traces,
    /// `[walker]`
    pub walker: WalkerTraining,
    pub(crate) resolved: String,
    pub(crate) portable: String,
}
