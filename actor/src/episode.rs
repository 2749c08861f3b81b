//! One environment, and its episode step by step.

use agents::{Act, Mode, Policy};
use rand_pcg::Pcg64Mcg;
use simulator::{RowBuffer, RowLayout, RowValues, Simulator, Step, Task, flags};

/// What an episode is played for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To learn from.
    Train,
    /// To measure how well it goes, while training.
    Test,
    /// For the score.
    Evaluate,
}

impl Purpose {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Train => "training",
            Self::Test => "test",
            Self::Evaluate => "evaluation",
        }
    }

    fn mode(self) -> Mode {
        match self {
            Self::Train => Mode::Explore,
            Self::Test | Self::Evaluate => Mode::Exploit,
        }
    }
}

/// How far a trajectory and an episode go.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    /// Control steps of an episode.
    pub(crate) steps: usize,
    /// Rows of a trajectory, its final row included.
    pub(crate) rows: usize,
    /// Words of the choices that end in a trajectory.
    pub(crate) choice_words: usize,
}

/// How an episode ended, or is so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tally {
    pub(crate) success: bool,
    pub(crate) fell: bool,
    pub(crate) steps: usize,
    /// The least distance to the goal.
    pub(crate) nearest: f32,
    /// Choices that ended, and those of them that were carried out.
    pub(crate) choices: [u32; 2],
}

impl Tally {
    const NONE: Self = Self {
        success: false,
        fell: false,
        steps: 0,
        nearest: f32::INFINITY,
        choices: [0; 2],
    };
}

/// What is to be done with the rows after a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Next {
    /// Nothing yet.
    Go,
    /// They are a trajectory.
    Send,
    /// They are a trajectory, and the episode's last.
    End,
}

/// A simulator with the episode that is played in it.
pub(crate) struct Environment {
    pub(crate) simulator: Box<dyn Simulator>,
    pub(crate) rng: Pcg64Mcg,
    pub(crate) act: Act,
    /// Steps since the last trajectory.
    pub(crate) rows: RowBuffer,
    /// Choices that ended since.
    pub(crate) choices: Vec<u32>,
    pub(crate) tally: Tally,
    pub(crate) purpose: Purpose,
    bounds: Bounds,
    goal: Vec<f32>,
    reached: Vec<f32>,
}

impl Environment {
    pub(crate) fn new(simulator: Box<dyn Simulator>, rng: Pcg64Mcg, bounds: Bounds) -> Self {
        let layout = RowLayout::new(&simulator.body().spaces());
        Self {
            simulator,
            rng,
            act: Act::default(),
            rows: RowBuffer::new(layout, bounds.rows),
            choices: Vec::with_capacity(bounds.choice_words),
            tally: Tally::NONE,
            purpose: Purpose::Train,
            bounds,
            goal: vec![],
            reached: vec![],
        }
    }

    /// Begins an episode.
    pub(crate) fn begin(&mut self, policy: &mut dyn Policy, task: &Task, purpose: Purpose) {
        self.simulator.reset(task, &mut self.rng);
        self.rows.clear();
        self.choices.clear();
        self.tally = Tally::NONE;
        self.purpose = purpose;
        self.goal.clear();
        self.goal.extend_from_slice(self.simulator.goal());
        policy.begin(&self.goal, purpose.mode());
    }

    /// Decides on the next action. Returns whether the rows so far have to be sent first, since there
    /// is no room for the choices that ended.
    pub(crate) fn decide(&mut self, policy: &mut dyn Policy) -> bool {
        if self.simulator.goal() != self.goal {
            self.goal.clear();
            self.goal.extend_from_slice(self.simulator.goal());
            policy.aim(&self.goal);
        }
        self.act.clear();
        let observation = self.simulator.observation();
        policy.act(observation, &mut self.rng, &mut self.act);
        if let Some(outcome) = self.act.outcome {
            self.tally.choices[0] += 1;
            self.tally.choices[1] += u32::from(outcome.reached);
        }
        let words = self.choices.len() + self.act.choices.len();
        words > self.bounds.choice_words && !self.rows.is_empty()
    }

    /// Takes the step that was decided on.
    pub(crate) fn step(&mut self, policy: &mut dyn Policy) -> (Step, Next) {
        self.choices.extend_from_slice(&self.act.choices);
        self.rows.push(RowValues {
            flags: 0,
            reward: 0.0,
            log_prob: self.act.log_prob,
            observation: self.simulator.observation(),
            action: &self.act.action,
            goal: &self.goal,
        });
        let step = self.simulator.step(&self.act.action);
        let tally = &mut self.tally;
        tally.steps += 1;
        tally.success = step.success;
        tally.fell = step.fell;
        self.reached.clear();
        self.simulator
            .goal_of(self.simulator.observation(), &mut self.reached);
        tally.nearest = tally.nearest.min(distance(&self.reached, &self.goal));
        // In training, a body that has fallen has nothing more to teach.
        let given_up = step.fell && self.purpose == Purpose::Train;
        let last = step.terminated || given_up || tally.steps >= self.bounds.steps;
        if last {
            policy.end(step.success, &mut self.choices);
        }
        self.rows.end_step(self.flags(step, last), step.reward);
        let next = if last {
            Next::End
        } else if self.rows.len() + 1 >= self.bounds.rows {
            Next::Send
        } else {
            Next::Go
        };
        (step, next)
    }

    fn flags(&self, step: Step, last: bool) -> u32 {
        let flag = |set: bool, flag: u32| if set { flag } else { 0 };
        flag(step.success, flags::SUCCESS)
            | flag(step.fell, flags::FELL)
            | flag(step.terminated, flags::TERMINAL)
            | flag(last && !step.terminated, flags::TRUNCATED)
            | flag(self.purpose != Purpose::Train, flags::TEST)
    }

    /// Appends the final row: the observation after the last step.
    pub(crate) fn close(&mut self) {
        self.rows.push(RowValues {
            flags: flags::FINAL,
            reward: 0.0,
            log_prob: 0.0,
            observation: self.simulator.observation(),
            action: &[],
            goal: self.simulator.goal(),
        });
    }

    /// Forgets what was sent.
    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.choices.clear();
    }
}

fn distance(a: &[f32], b: &[f32]) -> f32 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
    squares.sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use agents::{Outcome, push_record, stream};
    use maze::Layout;
    use simulator::{Tasks, Values};

    use super::*;

    const BOUNDS: Bounds = Bounds {
        steps: 60,
        rows: 20,
        choice_words: 8,
    };

    /// Goes straight for the goal, and ends a choice of two words every fifth step.
    #[derive(Default)]
    struct Straight {
        goal: [f32; 2],
        acts: usize,
        ended: bool,
        still: bool,
    }

    impl Policy for Straight {
        fn begin(&mut self, goal: &[f32], mode: Mode) {
            assert_eq!(mode, Mode::Explore);
            self.goal = [goal[0], goal[1]];
            self.acts = 0;
        }

        fn act(&mut self, observation: Values<'_>, _: &mut Pcg64Mcg, act: &mut Act) {
            let o = observation.floats().unwrap();
            let towards = [self.goal[0] - o[0], self.goal[1] - o[1]];
            let length = towards[0].hypot(towards[1]).max(1e-6);
            let speed = if self.still { 0.0 } else { 1.0 };
            act.action.extend(towards.map(|axis| speed * axis / length));
            act.log_prob = -1.0;
            self.acts += 1;
            if self.acts.is_multiple_of(5) {
                push_record(&[self.acts as u32, 7], &mut act.choices);
                act.outcome = Some(Outcome {
                    from: 0,
                    to: 1,
                    reached: self.acts.is_multiple_of(10),
                });
            }
        }

        fn end(&mut self, success: bool, choices: &mut Vec<u32>) {
            self.ended = success;
            push_record(&[99], choices);
        }
    }

    fn environment() -> Environment {
        let layout = Layout::from_rows(&["r000g"]).unwrap();
        let simulator = simulators::create("point", &layout, 0.5).unwrap();
        Environment::new(simulator, stream(1, "test", 0), BOUNDS)
    }

    /// An episode's trajectories: rows, flags of the last step, choices.
    fn play(policy: &mut Straight) -> (Vec<(usize, u32, Vec<u32>)>, Tally) {
        let mut environment = environment();
        let task = Task {
            start: [0.0, 0.0],
            goal: vec![8.0, 0.0],
        };
        environment.begin(policy, &task, Purpose::Train);
        let mut sent = vec![];
        loop {
            let mut send = |environment: &mut Environment| {
                environment.close();
                let rows = environment.rows.rows();
                let last = rows.row(rows.len() - 2);
                assert!(rows.row(rows.len() - 1).has(flags::FINAL));
                assert!(rows.iter().all(|row| row.is_finite()));
                sent.push((rows.len(), last.flags(), environment.choices.clone()));
                environment.clear();
            };
            if environment.decide(policy) {
                send(&mut environment);
            }
            let (step, next) = environment.step(policy);
            assert_eq!(step.reward, f32::from(u8::from(step.success)));
            if next != Next::Go {
                send(&mut environment);
            }
            if next == Next::End {
                return (sent, environment.tally);
            }
        }
    }

    #[test]
    fn an_episode_that_succeeds_ends_there_in_whole_trajectories() {
        let mut policy = Straight::default();
        let (sent, tally) = play(&mut policy);
        assert!(tally.success && policy.ended && !tally.fell);
        assert!(tally.nearest <= 0.5 && tally.steps < BOUNDS.steps);
        let steps: usize = sent.iter().map(|(rows, ..)| rows - 1).sum();
        assert_eq!(steps, tally.steps);
        let (_, flags_of_last, choices) = sent.last().unwrap();
        assert_eq!(*flags_of_last, flags::SUCCESS | flags::TERMINAL);
        assert_eq!(choices[choices.len() - 2..], [1, 99]);
        for (rows, flags, choices) in &sent[..sent.len() - 1] {
            assert!(*rows <= BOUNDS.rows && *flags == 0);
            assert!(choices.len() <= BOUNDS.choice_words);
        }
        let ended = (tally.steps / 5) as u32;
        assert_eq!(tally.choices, [ended, ended / 2]);
    }

    #[test]
    fn an_episode_without_success_is_cut_off() {
        let mut policy = Straight {
            still: true,
            ..Straight::default()
        };
        let (sent, tally) = play(&mut policy);
        assert!(!tally.success && tally.steps == BOUNDS.steps);
        assert_eq!(sent.last().unwrap().1, flags::TRUNCATED);
        assert!((tally.nearest - 8.0).abs() < 0.3, "{}", tally.nearest);
        // Choices of three words each: two of them fit.
        let choices: usize = sent.iter().map(|(.., choices)| choices.len()).sum();
        assert_eq!(choices, 12 * 3 + 2);
    }

    #[test]
    fn rows_of_tests_are_marked() {
        let mut environment = environment();
        let mut rng = stream(2, "test", 0);
        let task = environment.simulator.draw(Tasks::Evaluation, &mut rng);
        struct Idle;
        impl Policy for Idle {
            fn begin(&mut self, _: &[f32], mode: Mode) {
                assert_eq!(mode, Mode::Exploit);
            }
            fn act(&mut self, _: Values<'_>, _: &mut Pcg64Mcg, act: &mut Act) {
                act.action.extend([0.0; 2]);
            }
        }
        environment.begin(&mut Idle, &task, Purpose::Test);
        assert!(!environment.decide(&mut Idle));
        environment.step(&mut Idle);
        assert!(environment.rows.rows().row(0).has(flags::TEST));
    }
}
