//! A machine: cores that its threads share in turns, as an operating system has them do.
//!
//! A team of threads takes tasks from one queue, in their order. Every thread that has a task gets a
//! slice of a core's time in its turn, so a team of one thread waits for no longer when another team
//! has a thousand tasks.

use std::{collections::VecDeque, time::Duration};

/// The longest that a thread keeps a core while others wait: about what Linux gives.
pub const SLICE: Duration = Duration::from_millis(1);

/// A number of threads with one queue of tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Team(usize);

/// Cores, and who waits for them. `T` says what follows a task.
#[derive(Debug)]
pub struct Machine<T> {
    cores: usize,
    busy: usize,
    teams: Vec<Waiting<T>>,
    // Threads that want a core, with the tasks that they have begun.
    ready: VecDeque<(Team, Option<Task<T>>)>,
    used: Duration,
}

#[derive(Debug)]
struct Waiting<T> {
    threads: usize,
    // Threads on a core, or waiting for one.
    awake: usize,
    tasks: VecDeque<Task<T>>,
}

#[derive(Debug)]
struct Task<T> {
    left: Duration,
    then: T,
}

/// A core's work until the machine has to be asked again.
#[derive(Debug)]
pub struct Slice<T> {
    team: Team,
    task: Task<T>,
    /// How long it takes.
    pub takes: Duration,
}

impl<T> Machine<T> {
    /// A machine with this many cores, at least one.
    pub fn new(cores: usize) -> Self {
        Self {
            cores: cores.max(1),
            busy: 0,
            teams: Vec::new(),
            ready: VecDeque::new(),
            used: Duration::ZERO,
        }
    }

    /// Adds a team of this many threads, at least one.
    pub fn add_team(&mut self, threads: usize) -> Team {
        self.teams.push(Waiting {
            threads: threads.max(1),
            awake: 0,
            tasks: VecDeque::new(),
        });
        Team(self.teams.len() - 1)
    }

    /// Gives a team a task that takes a core so long.
    pub fn give(&mut self, team: Team, takes: Duration, then: T) {
        let waiting = &mut self.teams[team.0];
        waiting.tasks.push_back(Task { left: takes, then });
        if waiting.awake < waiting.threads {
            waiting.awake += 1;
            self.ready.push_back((team, None));
        }
    }

    /// Drops what a team has not begun.
    pub fn forget(&mut self, team: Team) {
        self.teams[team.0].tasks.clear();
    }

    /// A slice for a core that is free, if there is one and something to do.
    pub fn start(&mut self) -> Option<Slice<T>> {
        if self.busy == self.cores {
            return None;
        }
        while let Some((team, begun)) = self.ready.pop_front() {
            let task = begun.or_else(|| self.teams[team.0].tasks.pop_front());
            let Some(task) = task else {
                self.teams[team.0].awake -= 1;
                continue;
            };
            self.busy += 1;
            let takes = task.left.min(SLICE);
            return Some(Slice { team, task, takes });
        }
        None
    }

    /// Notes that a slice is over; returns what follows its task if that is done.
    pub fn end(&mut self, slice: Slice<T>) -> Option<T> {
        let Slice {
            team,
            mut task,
            takes,
        } = slice;
        self.busy -= 1;
        self.used += takes;
        task.left -= takes;
        if !task.left.is_zero() {
            self.ready.push_back((team, Some(task)));
            return None;
        }
        self.ready.push_back((team, None));
        Some(task.then)
    }

    /// Processor time used so far, of all cores together.
    pub fn used(&self) -> Duration {
        self.used
    }

    /// How many cores it has.
    pub fn cores(&self) -> usize {
        self.cores
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        draws::{Draw, exponential},
        events::Events,
    };

    /// Runs all tasks; when each ended, milliseconds.
    fn run(machine: &mut Machine<char>) -> Vec<(char, u128)> {
        let mut events = Events::default();
        let mut ended = Vec::new();
        loop {
            while let Some(slice) = machine.start() {
                events.after(slice.takes, slice);
            }
            let Some(slice) = events.take_next() else {
                return ended;
            };
            if let Some(name) = machine.end(slice) {
                ended.push((name, events.now().as_millis()));
            }
        }
    }

    #[test]
    fn cores_are_shared_and_nothing_is_lost() {
        let mut machine = Machine::new(2);
        let team = machine.add_team(8);
        for name in ['a', 'b', 'c'] {
            machine.give(team, Duration::from_millis(4), name);
        }
        let ended = run(&mut machine);
        assert_eq!(machine.used(), Duration::from_millis(12));
        // All three share the two cores, so the last ends when all is done.
        assert_eq!(ended.last().map(|(_, at)| *at), Some(6), "{ended:?}");
    }

    #[test]
    fn a_small_task_of_one_team_does_not_wait_for_many_of_another() {
        let mut machine = Machine::new(1);
        let (many, one) = (machine.add_team(1), machine.add_team(1));
        for _ in 0..100 {
            machine.give(many, Duration::from_millis(1), 'm');
        }
        machine.give(one, Duration::from_millis(1), 'o');
        let ended = run(&mut machine);
        assert!(ended.contains(&('o', 2)), "{ended:?}");
        assert_eq!(ended.len(), 101);
    }

    /// Poisson arrivals, one core, equal tasks: Pollaczek and Khinchine's mean wait is
    /// rho / (2 (1 - rho)) services.
    #[test]
    fn a_queue_before_one_core_waits_as_theory_has_it() {
        const ARRIVALS: u64 = 200_000;
        let service = Duration::from_micros(800);
        let between = Duration::from_millis(1);
        let mut machine = Machine::new(1);
        let team = machine.add_team(1);
        // A slice that ends, or the arrival of a task by its number.
        let mut events: Events<Result<Slice<Duration>, u64>> = Events::default();
        events.after(Duration::ZERO, Err(0));
        let mut waited = Duration::ZERO;
        while let Some(event) = events.take_next() {
            match event {
                Ok(slice) => {
                    if let Some(arrived) = machine.end(slice) {
                        waited += events.now() - arrived - service;
                    }
                }
                Err(number) => {
                    machine.give(team, service, events.now());
                    if number + 1 < ARRIVALS {
                        let pause = exponential(3, Draw::Life, number, between);
                        events.after(pause, Err(number + 1));
                    }
                }
            }
            while let Some(slice) = machine.start() {
                events.after(slice.takes, Ok(slice));
            }
        }
        let mean = waited.as_secs_f64() / ARRIVALS as f64;
        let theory = 0.8 / (2.0 * 0.2) * service.as_secs_f64();
        // Over seeds the ratio's standard deviation is 2 percent.
        assert!((mean / theory - 1.0).abs() < 0.1, "{}", mean / theory);
    }

    #[test]
    fn what_is_forgotten_is_not_done() {
        let mut machine = Machine::new(1);
        let team = machine.add_team(1);
        machine.give(team, SLICE, 'a');
        machine.give(team, SLICE, 'b');
        machine.forget(team);
        machine.give(team, SLICE, 'c');
        assert_eq!(run(&mut machine), [('c', 1)]);
    }
}
