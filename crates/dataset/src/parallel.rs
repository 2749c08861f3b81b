//! Work that is split over the machine's cores.

use std::sync::{Mutex, PoisonError};
use std::thread;

/// Threads at most: decoding is bound by memory beyond that.
const THREADS: usize = 8;

/// Does all jobs on as many threads as there are cores. Of several errors the one of the earliest
/// job is returned, so that the same file always gives the same error.
pub(crate) fn each<J: Send, E: Send>(
    jobs: Vec<J>,
    work: impl Fn(J) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.min(THREADS).min(jobs.len());
    if threads <= 1 {
        return jobs.into_iter().try_for_each(work);
    }
    let queue = Mutex::new(jobs.into_iter().enumerate());
    let first: Mutex<Option<(usize, E)>> = Mutex::new(None);
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let worker = || {
        while let Some((number, job)) = next() {
            if let Err(error) = work(job) {
                let mut first = first.lock().unwrap_or_else(PoisonError::into_inner);
                if first.as_ref().is_none_or(|(other, _)| number < *other) {
                    *first = Some((number, error));
                }
                // Earlier jobs are with the other threads already.
                break;
            }
        }
    };
    thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(worker);
        }
        worker();
    });
    let first = first.into_inner().unwrap_or_else(PoisonError::into_inner);
    first.map_or(Ok(()), |(_, error)| Err(error))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn all_jobs_are_done_and_the_earliest_error_counts() {
        let sum = AtomicUsize::new(0);
        let done: Result<(), ()> = each((0..100).collect(), |job| {
            sum.fetch_add(job, Ordering::Relaxed);
            Ok(())
        });
        assert_eq!((done, sum.into_inner()), (Ok(()), 4950));
        for _ in 0..100 {
            let failed = each((0..100).collect(), |job| {
                if job % 7 == 3 { Err(job) } else { Ok(()) }
            });
            assert_eq!(failed, Err(3));
        }
        assert_eq!(each(vec![], |_: usize| Err(1)), Ok(()));
    }
}
