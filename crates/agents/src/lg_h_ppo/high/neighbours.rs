//! The high level's distribution.

use nets::categorical::Masked;

use crate::actor_critic::Distribution;

/// The softmax over each choice's open neighbours; all other nodes are masked.
pub(crate) struct Neighbours<O, P> {
    open: O,
    picked: P,
    allowed: Vec<usize>,
}

impl<O: Fn(usize, &mut Vec<usize>), P: Fn(usize) -> usize> Neighbours<O, P> {
    /// `open` appends the nodes that sample `i` chose among, `picked` is the one that it chose.
    pub(crate) fn new(open: O, picked: P) -> Self {
        Self {
            open,
            picked,
            allowed: vec![],
        }
    }
}

impl<O: Fn(usize, &mut Vec<usize>), P: Fn(usize) -> usize> Distribution for Neighbours<O, P> {
    fn grade(
        &mut self,
        i: usize,
        outputs: &[f32],
        _free: &[f32],
        weigh: impl FnOnce(f32, f32) -> [f32; 2],
        output_gradient: &mut [f32],
        _free_gradient: &mut [f32],
    ) -> bool {
        self.allowed.clear();
        (self.open)(i, &mut self.allowed);
        let node = (self.picked)(i);
        let Some(picked) = self.allowed.iter().position(|&other| other == node) else {
            return false;
        };
        let Some(masked) = Masked::new(outputs, &self.allowed) else {
            return false;
        };
        let [log_weight, entropy_weight] = weigh(masked.log_prob(picked), masked.entropy());
        masked.add_gradient(picked, log_weight, entropy_weight, output_gradient);
        true
    }
}
