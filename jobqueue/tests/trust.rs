//! Who is believed: votes and blocks by identity, newcomers on probation, audits at the end, and the
//! operator's last word.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use dataset::{CompletedView, Digest, ErrorStatistics};
use jobqueue::{
    BlockCause, Changes, Fingerprint, JobState, Policy, Queue, RedundantRender, Refusal, Verdict,
    identity::{OPERATOR, full_name},
    token::{Token, WorkerId},
};
use std::time::Duration;

const NOW: Duration = Duration::from_secs(5);

/// A farm whose workers are known by (credential, name).
struct Farm {
    queue: Queue,
    tokens: u128,
}

fn images(of: u8) -> Fingerprint {
    Fingerprint::of(&[CompletedView {
        digest: Digest::of(&[of]),
        bytes: 3,
        statistics: ErrorStatistics {
            mean: 0.0,
            p95: 0.0,
            max: 0.0,
            within_target: 1.0,
            samples: 0,
            evaluations: 0,
        },
        pixels: None,
    }])
}

const TRUTH: u8 = 0;
const LIE: u8 = 1;

impl Farm {
    fn new(materials: u32, probation: u32, audits: u32) -> Self {
        let policy = Policy {
            probation,
            audits,
            ..Policy::default()
        };
        Self {
            queue: Queue::new(materials, policy),
            tokens: 0,
        }
    }

    fn id(&mut self, credential: &str, name: &str) -> WorkerId {
        let full = full_name(Some(credential), name);
        let id = WorkerId::from_bytes(
            *Digest::of(full.as_bytes())
                .as_bytes()
                .first_chunk()
                .unwrap(),
        );
        self.queue.admit(id, &full);
        id
    }

    fn claim(&mut self, worker: WorkerId) -> Option<(Token, u32)> {
        self.tokens += 1;
        let token = Token::from_bytes(self.tokens.to_be_bytes());
        let changes = self.queue.claim(worker, &[token], NOW);
        changes.jobs.first().map(|change| (token, change.material))
    }

    fn deliver(
        &mut self,
        (token, material): (Token, u32),
        what: u8,
    ) -> Result<(Verdict, Changes), Refusal> {
        self.queue
            .complete(material, token, images(what), false, NOW)
    }

    /// Claims and delivers one job; none where there is none.
    fn render(&mut self, worker: WorkerId, what: u8) -> Option<(u32, Verdict)> {
        let job = self.claim(worker)?;
        let (verdict, _) = self.deliver(job, what).unwrap();
        Some((job.1, verdict))
    }

    fn redundant(&self, material: u32) -> RedundantRender {
        match &self.queue.job(material).unwrap().state {
            JobState::Completed { redundant, .. } => redundant.clone(),
            state => panic!("{state:?}"),
        }
    }
}

#[test]
fn newcomers_are_rendered_again_by_somebody_else() {
    let mut farm = Farm::new(9, 2, 0);
    let [alice, other_name, bob] =
        [("alice", "one"), ("alice", "two"), ("bob", "one")].map(|(c, n)| farm.id(c, n));
    for material in 0..2 {
        assert_eq!(
            farm.render(alice, TRUTH),
            Some((material, Verdict::Recorded))
        );
        assert_eq!(farm.redundant(material), RedundantRender::Due);
    }
    // Another name of the same credential is neither a newcomer nor somebody else.
    assert_eq!(farm.render(other_name, TRUTH), Some((2, Verdict::Recorded)));
    assert_eq!(farm.redundant(2), RedundantRender::None);
    assert_eq!(farm.render(bob, TRUTH), Some((0, Verdict::Agreed)));
    assert_eq!(farm.render(bob, TRUTH), Some((1, Verdict::Agreed)));
    assert_eq!(farm.render(bob, TRUTH), Some((3, Verdict::Recorded)));
    assert_eq!(farm.redundant(3), RedundantRender::Due);
}

#[test]
fn two_names_of_one_credential_are_one_voice_and_one_block() {
    let mut farm = Farm::new(9, 1, 0);
    let [one, two, bob, carol] =
        [("eve", "one"), ("eve", "two"), ("bob", "b"), ("carol", "c")].map(|(c, n)| farm.id(c, n));
    assert_eq!(farm.render(one, LIE), Some((0, Verdict::Recorded)));
    assert_eq!(farm.render(two, LIE), Some((1, Verdict::Recorded)));
    assert_eq!(farm.render(bob, TRUTH), Some((0, Verdict::Disputed)));
    // The second name cannot be the third opinion.
    let held = farm.claim(two).unwrap();
    assert_eq!(held.1, 2);
    let overturned = Verdict::Overturned("eve/one".to_owned());
    assert_eq!(farm.render(carol, TRUTH), Some((0, overturned)));
    // All that either vouched for alone is to be done again, and neither gets work.
    assert_eq!(farm.queue.job(1).unwrap().state, JobState::Pending);
    assert_eq!(farm.deliver(held, LIE), Err(Refusal::LeaseLost(2)));
    let three = farm.id("eve", "three");
    for name in [one, two, three] {
        assert_eq!(farm.claim(name), None);
    }
    // Forgiven, it begins anew: its next is looked at.
    assert!(farm.queue.unblock("eve/").is_some());
    let (material, _) = farm.render(three, TRUTH).unwrap();
    assert_eq!(farm.redundant(material), RedundantRender::Due);
}

#[test]
fn what_is_wrong_is_found_before_a_set_is_finished_however_late_a_liar_begins() {
    let mut farm = Farm::new(60, 1, 3);
    let [eve, bob, carol] =
        [("eve", "e"), ("bob", "b"), ("carol", "c")].map(|(c, n)| farm.id(c, n));
    let mut rendered = 0;
    while farm.queue.counts().pending > 0 {
        rendered += 1;
        farm.render(eve, if rendered > 5 { LIE } else { TRUTH });
        farm.render(bob, TRUTH);
        farm.render(carol, TRUTH);
    }
    assert!(!farm.queue.is_finished(), "audits are due");
    let drawn = farm.queue.draw_audits(7, NOW);
    assert_eq!(drawn.jobs.len(), 9);
    assert_eq!(
        farm.queue.draw_audits(8, NOW),
        Changes::default(),
        "drawn once"
    );
    loop {
        let rounds = [(bob, TRUTH), (carol, TRUTH), (eve, TRUTH)];
        let done = rounds.map(|(worker, what)| farm.render(worker, what));
        let idle = done.iter().all(Option::is_none);
        if idle && farm.queue.draw_audits(9, NOW).is_empty() {
            break;
        }
    }
    assert!(farm.queue.is_finished());
    assert!(farm.queue.block_of("eve/again").is_some());
    for (material, job) in farm.queue.jobs_from(0) {
        let JobState::Completed { fingerprint, .. } = &job.state else {
            panic!("{material}: {:?}", job.state);
        };
        assert!(
            fingerprint.agrees_with(images(TRUTH)),
            "material {material}"
        );
    }
}

#[test]
fn a_tie_ends_the_set_undecided_and_the_operator_decides() {
    for (first, second, ruling) in [(TRUTH, LIE, TRUTH), (LIE, TRUTH, TRUTH), (LIE, 2, TRUTH)] {
        let mut farm = Farm::new(1, 1, 0);
        let [alice, bob] = [("alice", "a"), ("bob", "b")].map(|(c, n)| farm.id(c, n));
        farm.render(alice, first);
        assert_eq!(farm.render(bob, second), Some((0, Verdict::Disputed)));
        assert!(farm.queue.is_finished(), "nobody who is there can decide");
        assert_eq!(farm.queue.counts().disputed, 1);
        let operator = farm.id(OPERATOR, "me");
        assert!(!farm.queue.is_finished());
        let (alice, bob) = ("alice/a".to_owned(), "bob/b".to_owned());
        let expected = match (first, second) {
            (TRUTH, _) => Verdict::Upheld(bob.clone()),
            (_, TRUTH) => Verdict::Overturned(alice.clone()),
            _ => Verdict::Ruled([alice.clone(), bob.clone()]),
        };
        assert_eq!(farm.render(operator, ruling), Some((0, expected)));
        assert!(farm.queue.is_finished());
        assert_eq!(farm.queue.block_of(&alice).is_some(), first != TRUTH);
        assert_eq!(farm.queue.block_of(&bob).is_some(), second != TRUTH);
        let JobState::Completed { fingerprint, .. } = &farm.queue.job(0).unwrap().state else {
            panic!("not complete");
        };
        assert!(fingerprint.agrees_with(images(TRUTH)));
    }
}

#[test]
fn the_operator_gets_disputes_and_nothing_else() {
    let mut farm = Farm::new(3, 1, 0);
    let operator = farm.id(OPERATOR, "me");
    let [alice, bob] = [("alice", "a"), ("bob", "b")].map(|(c, n)| farm.id(c, n));
    assert_eq!(farm.claim(operator), None);
    farm.render(alice, TRUTH);
    assert_eq!(
        farm.claim(operator),
        None,
        "redundant renders are the workers'"
    );
    assert!(farm.queue.is_finished_for("operator/me"));
    assert!(!farm.queue.is_finished_for("bob/b"));
    farm.render(bob, LIE);
    assert!(!farm.queue.is_finished_for("operator/me"));
    assert_eq!(farm.claim(operator).map(|(_, material)| material), Some(0));
}

#[test]
fn a_machine_that_fails_is_blocked_without_the_others_of_its_credential() {
    let mut farm = Farm::new(9, 0, 0);
    let [broken, sound] = [("lab", "broken"), ("lab", "sound")].map(|(c, n)| farm.id(c, n));
    for _ in 0..Policy::default().jobs_failed_max {
        let (token, material) = farm.claim(broken).unwrap();
        farm.queue.fail(material, token, "no light", NOW).unwrap();
    }
    let block = farm.queue.block_of("lab/broken").unwrap();
    assert_eq!(block.cause, BlockCause::Failures);
    assert!(farm.claim(broken).is_none());
    assert!(farm.claim(sound).is_some());
}
