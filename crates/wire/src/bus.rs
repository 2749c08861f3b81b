//! A process's place on a run's channels: its iceoryx2 node, the services and their limits.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::node::CleanupState;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event::PortFactory as EventFactory;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::WireError;
use crate::cause::Cause;
use crate::directive::Directive;
use crate::domain::RunDomain;
use crate::limits::{HELD, Limits, Part, Qos, SPARE};
use crate::records::{
    Acknowledgement, AcknowledgementHeader, LAYOUT, SnapshotHeader, TrajectoryHeader,
};
use crate::status::{EpisodeResult, Metric, Status};

pub(crate) type Ipc = ipc::Service;
pub(crate) type Topic<T, H> = PortFactory<Ipc, [T], H>;

/// Events that wake a process which waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waker {
    /// Wakes learner and graph-builder: trajectories, weights or a graph are there.
    Readers,
    /// Wakes actors: acknowledgements or a directive are there.
    Actors,
}

impl Waker {
    fn service(self) -> &'static str {
        match self {
            Self::Readers => "wake-readers",
            Self::Actors => "wake-actors",
        }
    }
}

/// An actor's id, held for as long as its process lives.
#[derive(Debug)]
pub struct Claim {
    /// The id.
    pub actor: u32,
    /// Held locked, with the process's incarnation in it.
    _lock: File,
}

fn claim_path(root: &std::path::Path, actor: u32) -> PathBuf {
    root.join(format!("actor-{actor}"))
}

/// A process's place on the channels.
pub struct Bus {
    node: Node<Ipc>,
    root: PathBuf,
    limits: Limits,
    /// The launcher makes the services and holds them; roles open them.
    held: Vec<Box<dyn std::any::Any>>,
    host: bool,
}

fn failed(
    service: &str,
    action: &'static str,
    root: &std::path::Path,
) -> impl Fn(String) -> WireError {
    move |reason| WireError::service(service, action, reason, Some(root))
}

/// How long a service may be in the middle of being made or cleaned up.
const PATIENCE: Duration = Duration::from_secs(3);

/// Tries until it works, for states that pass: a dead neighbour is being cleaned up just now, or
/// still holds the place that is asked for.
fn patiently<T, E: Debug>(
    node: &Node<Ipc>,
    mut attempt: impl FnMut() -> Result<T, E>,
) -> Result<T, String> {
    let start = Instant::now();
    loop {
        match attempt() {
            Ok(value) => return Ok(value),
            Err(error) if start.elapsed() > PATIENCE => return Err(format!("{error:?}")),
            Err(_) => {
                let _ = node.blocking_cleanup_dead_nodes(Duration::from_millis(200));
                let _ = node.wait(Duration::from_millis(20));
            }
        }
    }
}

impl Bus {
    /// The launcher's place: makes every service of the run and holds it.
    ///
    /// # Errors
    /// What the file system or iceoryx2 refuses.
    pub fn host(domain: &RunDomain, limits: &Limits) -> Result<Self, WireError> {
        let path = domain.root().join("limits");
        fs::write(&path, limits.to_text()).map_err(|reason| WireError::Io {
            path: path.display().to_string(),
            reason,
        })?;
        let mut bus = Self::join_as(domain, "launcher", limits.clone(), true)?;
        bus.held = bus.all()?;
        Ok(bus)
    }

    /// A role's place: opens what the launcher made.
    ///
    /// # Errors
    /// Another layout, limits that cannot be read, what iceoryx2 refuses.
    pub fn join(domain: &RunDomain, name: &str) -> Result<Self, WireError> {
        let path = domain.root().join("limits");
        let text = fs::read_to_string(&path).map_err(|reason| WireError::Io {
            path: path.display().to_string(),
            reason,
        })?;
        let (theirs, limits) = Limits::from_text(&text).unwrap_or_default();
        let Some(limits) = limits.filter(|_| theirs == LAYOUT) else {
            return Err(WireError::Layout {
                theirs,
                ours: LAYOUT,
            });
        };
        Self::join_as(domain, name, limits, false)
    }

    fn join_as(
        domain: &RunDomain,
        name: &str,
        limits: Limits,
        host: bool,
    ) -> Result<Self, WireError> {
        limits.allow()?;
        limits.allow_segments()?;
        crate::logging::forward();
        let failed = |reason| WireError::Join {
            name: name.to_owned(),
            cause: Cause::of(reason, Some(domain.root())),
        };
        let mut config = Config::default();
        let root = format!("{}/", domain.root().display());
        let root = Path::new(root.as_bytes()).map_err(|e| failed(format!("{e:?}")))?;
        config.global.set_root_path(&root);
        config.global.prefix =
            FileName::new(domain.prefix().as_bytes()).map_err(|e| failed(format!("{e:?}")))?;
        config.global.creation_timeout = PATIENCE;
        let label = NodeName::new(name).map_err(|e| failed(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&label)
            .config(&config)
            // Signals are the program's own business.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|e| failed(format!("{e:?}")))?;
        // iceoryx2 lets all users open the node's own segment, the services' it does not.
        domain.make_private().map_err(|e| failed(e.to_string()))?;
        Ok(Self {
            node,
            root: domain.root().to_path_buf(),
            limits,
            held: vec![],
            host,
        })
    }

    /// Takes an actor's id for this process.
    ///
    /// # Errors
    /// [`WireError::Taken`] while another process holds it, or what the file system refuses.
    pub fn claim(&self, actor: u32) -> Result<Claim, WireError> {
        // Whoever looks whether it is taken holds it for a moment.
        let start = Instant::now();
        loop {
            match self.try_claim(actor) {
                Err(WireError::Taken(_)) if start.elapsed() < Duration::from_millis(500) => {
                    let _ = self.node.wait(Duration::from_millis(20));
                }
                claim => return claim,
            }
        }
    }

    fn try_claim(&self, actor: u32) -> Result<Claim, WireError> {
        let path = claim_path(&self.root, actor);
        let failed = |reason| WireError::Io {
            path: path.display().to_string(),
            reason,
        };
        let mut lock = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(&path)
            .map_err(failed)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(fs::TryLockError::WouldBlock) => return Err(WireError::Taken(actor)),
            Err(fs::TryLockError::Error(reason)) => return Err(failed(reason)),
        }
        lock.set_len(0).map_err(failed)?;
        write!(lock, "{}", crate::incarnation()).map_err(failed)?;
        Ok(Claim { actor, _lock: lock })
    }

    /// Takes the first free id from `first` on.
    ///
    /// # Errors
    /// [`WireError::Full`] when there is none, or what the file system refuses.
    pub fn claim_any(&self, first: u32) -> Result<Claim, WireError> {
        for actor in first..self.limits.max_actors as u32 {
            match self.try_claim(actor) {
                Err(WireError::Taken(_)) => {}
                claim => return claim,
            }
        }
        Err(WireError::Full(self.limits.max_actors))
    }

    /// Incarnation of the process that last took an actor's id.
    pub(crate) fn claimed(root: &std::path::Path, actor: u32) -> Option<u32> {
        let text = fs::read_to_string(claim_path(root, actor)).ok()?;
        text.parse().ok()
    }

    /// Whether a process holds an actor's id, or it cannot be told that none does.
    pub(crate) fn is_claimed(root: &std::path::Path, actor: u32) -> bool {
        match File::open(claim_path(root, actor)) {
            Ok(file) => file.try_lock_shared().is_err(),
            Err(error) => error.kind() != ErrorKind::NotFound,
        }
    }

    pub(crate) fn root(&self) -> &std::path::Path {
        &self.root
    }

    /// The run's limits.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Takes back what dead processes held. Whether there was any.
    pub fn sweep(&self) -> bool {
        let CleanupState { cleanups, .. } = self
            .node
            .blocking_cleanup_dead_nodes(Duration::from_millis(500));
        cleanups > 0
    }

    fn all(&self) -> Result<Vec<Box<dyn std::any::Any>>, WireError> {
        let mut held: Vec<Box<dyn std::any::Any>> = vec![
            Box::new(self.trajectories()?),
            Box::new(self.acknowledgements()?),
            Box::new(self.graph()?),
            Box::new(self.directive()?),
            Box::new(self.report::<Status>("status")?),
            Box::new(self.report::<Metric>("metrics")?),
            Box::new(self.report::<EpisodeResult>("results")?),
            Box::new(self.event(Waker::Readers)?),
            Box::new(self.event(Waker::Actors)?),
        ];
        for part in &self.limits.parts {
            held.push(Box::new(self.weights(part)?));
        }
        Ok(held)
    }

    fn topic<T, H>(&self, name: &str, qos: &Qos) -> Result<Topic<T, H>, WireError>
    where
        T: Debug + ZeroCopySend + 'static,
        H: Debug + ZeroCopySend + 'static,
    {
        let service = |reason| failed(name, "be opened", &self.root)(reason);
        let label = ServiceName::new(name).map_err(|e| service(format!("{e:?}")))?;
        patiently(&self.node, || {
            let builder = self
                .node
                .service_builder(&label)
                .publish_subscribe::<[T]>()
                .user_header::<H>()
                .max_publishers(qos.publishers)
                .max_subscribers(qos.subscribers)
                .max_nodes(self.limits.processes() + SPARE)
                .history_size(qos.history)
                .subscriber_max_buffer_size(qos.buffer)
                .subscriber_max_borrowed_samples(HELD)
                .enable_safe_overflow(qos.overflow);
            if self.host {
                builder.open_or_create().map_err(|e| format!("{e:?}"))
            } else {
                builder.open().map_err(|e| format!("{e:?}"))
            }
        })
        .map_err(service)
    }

    pub(crate) fn trajectories(&self) -> Result<Topic<u32, TrajectoryHeader>, WireError> {
        self.topic("trajectories", &self.limits.trajectory_qos())
    }

    pub(crate) fn acknowledgements(
        &self,
    ) -> Result<Topic<Acknowledgement, AcknowledgementHeader>, WireError> {
        // One latest table of each reader: a place in the buffer for both.
        let qos = Qos {
            publishers: 2 + SPARE,
            buffer: 4,
            ..self.limits.latest_qos()
        };
        self.topic("acknowledgements", &qos)
    }

    pub(crate) fn weights(&self, part: &Part) -> Result<Topic<f32, SnapshotHeader>, WireError> {
        self.topic(&part.service(), &self.limits.latest_qos())
    }

    pub(crate) fn graph(&self) -> Result<Topic<u8, SnapshotHeader>, WireError> {
        self.topic("graph", &self.limits.latest_qos())
    }

    pub(crate) fn directive(&self) -> Result<Topic<Directive, SnapshotHeader>, WireError> {
        self.topic("directive", &self.limits.latest_qos())
    }

    pub(crate) fn report<T>(&self, name: &str) -> Result<Topic<T, SnapshotHeader>, WireError>
    where
        T: Debug + ZeroCopySend + 'static,
    {
        self.topic(name, &self.limits.report_qos())
    }

    fn event(&self, waker: Waker) -> Result<EventFactory<Ipc>, WireError> {
        let name = waker.service();
        let service = |reason| failed(name, "be opened", &self.root)(reason);
        let label = ServiceName::new(name).map_err(|e| service(format!("{e:?}")))?;
        let places = 2 * self.limits.processes();
        patiently(&self.node, || {
            let builder = self
                .node
                .service_builder(&label)
                .event()
                .max_notifiers(places)
                .max_listeners(places)
                .max_nodes(places)
                .event_id_max_value(15);
            if self.host {
                builder.open_or_create().map_err(|e| format!("{e:?}"))
            } else {
                builder.open().map_err(|e| format!("{e:?}"))
            }
        })
        .map_err(service)
    }

    pub(crate) fn notifier(&self, waker: Waker) -> Result<Notifier<Ipc>, WireError> {
        let factory = self.event(waker)?;
        let failed = failed(waker.service(), "get a notifier", &self.root);
        patiently(&self.node, || factory.notifier_builder().create()).map_err(failed)
    }

    pub(crate) fn listener(&self, waker: Waker) -> Result<Listener<Ipc>, WireError> {
        let factory = self.event(waker)?;
        let failed = failed(waker.service(), "get a listener", &self.root);
        patiently(&self.node, || factory.listener_builder().create()).map_err(failed)
    }

    /// Makes a port, patiently: a dead process may still hold its place.
    pub(crate) fn port<T, E: Debug>(
        &self,
        name: &str,
        action: &'static str,
        make: impl FnMut() -> Result<T, E>,
    ) -> Result<T, WireError> {
        patiently(&self.node, make).map_err(failed(name, action, &self.root))
    }
}

/// Sleeps until the listener is woken, at most for `timeout`.
pub(crate) fn sleep(listener: &Listener<Ipc>, timeout: Duration) {
    let _ = listener.timed_wait(|_| {}, timeout);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::tests::limits;

    #[test]
    fn another_layout_is_refused_by_name() {
        let domain = RunDomain::create().unwrap();
        let _host = Bus::host(&domain, &limits()).unwrap();
        let path = domain.root().join("limits");
        let text = fs::read_to_string(&path).unwrap();
        let ours = format!("layout={LAYOUT}");
        assert!(text.contains(&ours));
        fs::write(&path, text.replace(&ours, "layout=7")).unwrap();
        let error = Bus::join(&domain, "actor-0").err().unwrap();
        assert!(
            matches!(
                error,
                WireError::Layout {
                    theirs: 7,
                    ours: LAYOUT
                }
            ),
            "{error}"
        );
        domain.remove();
    }

    #[test]
    fn nothing_is_left_after_removal() {
        let domain = RunDomain::create().unwrap();
        let prefix = domain.prefix();
        let host = Bus::host(&domain, &limits()).unwrap();
        drop(host);
        domain.remove();
        let left: Vec<_> = fs::read_dir("/dev/shm")
            .unwrap()
            .flatten()
            .map(|entry| entry.file_name().into_string().unwrap())
            .filter(|name| name.contains(&prefix))
            .collect();
        assert_eq!(left, Vec::<String>::new());
    }
}
