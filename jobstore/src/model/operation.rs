//! The operations, drawn at random.

use super::{MATERIALS, WORKERS};
use jobqueue::Mode;
use proptest::prelude::*;

/// Tokens are named by the order they were given out in, so that operations can show old ones.
#[derive(Clone, Debug)]
#[allow(
    missing_docs,
    reason = "each is an operation of `JobStore`, with its arguments"
)]
pub enum Operation {
    Admit {
        worker: u8,
    },
    Dismiss {
        worker: u8,
    },
    Claim {
        worker: u8,
        jobs_max: u32,
    },
    Renew {
        back: usize,
        views_done: u32,
    },
    Complete {
        back: usize,
        images: u8,
        check: bool,
    },
    CompleteOther {
        back: usize,
        material: u32,
    },
    Fail {
        back: usize,
    },
    Release {
        worker: u8,
    },
    ReleaseAll,
    Wait {
        seconds: u64,
    },
    Restart,
    RetryQuarantined,
    Retry {
        materials: Vec<u32>,
    },
    Cancel {
        materials: Vec<u32>,
    },
    Prioritize {
        materials: Vec<u32>,
        priority: i32,
    },
    SetMode {
        mode: Mode,
    },
    Block {
        worker: u8,
    },
    Unblock {
        worker: u8,
    },
    Trust {
        worker: u8,
    },
    DrawAudits {
        seed: u64,
    },
}

/// Any operation; likely ones more often.
pub fn operation() -> impl Strategy<Value = Operation> {
    let materials = || prop::collection::vec(0..MATERIALS + 2, 0..4);
    let mode = prop_oneof![
        6 => Just(Mode::Running), 1 => Just(Mode::Paused), 1 => Just(Mode::Draining)
    ];
    // `back` counts from the newest token: most operations then meet a lease that is alive.
    prop_oneof![
        3 => (0..WORKERS).prop_map(|worker| Operation::Admit { worker }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Dismiss { worker }),
        8 => (0..WORKERS, 0..4u32)
            .prop_map(|(worker, jobs_max)| Operation::Claim { worker, jobs_max }),
        4 => (0..8usize, 0..4u32)
            .prop_map(|(back, views_done)| Operation::Renew { back, views_done }),
        7 => (0..12usize, prop_oneof![6 => Just(0u8), 1 => Just(1u8), 1 => Just(2u8)], any::<bool>())
            .prop_map(|(back, images, check)| Operation::Complete { back, images, check }),
        1 => (0..6usize, 0..MATERIALS + 2)
            .prop_map(|(back, material)| Operation::CompleteOther { back, material }),
        2 => (0..10usize).prop_map(|back| Operation::Fail { back }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Release { worker }),
        1 => Just(Operation::ReleaseAll),
        4 => (0..8u64).prop_map(|seconds| Operation::Wait { seconds }),
        1 => Just(Operation::Restart),
        1 => Just(Operation::RetryQuarantined),
        1 => materials().prop_map(|materials| Operation::Retry { materials }),
        1 => materials().prop_map(|materials| Operation::Cancel { materials }),
        1 => (materials(), -2..3i32)
            .prop_map(|(materials, priority)| Operation::Prioritize { materials, priority }),
        1 => mode.prop_map(|mode| Operation::SetMode { mode }),
        1 => (0..WORKERS).prop_map(|worker| Operation::Block { worker }),
        2 => (0..WORKERS).prop_map(|worker| Operation::Unblock { worker }),
        2 => (0..WORKERS).prop_map(|worker| Operation::Trust { worker }),
        3 => any::<u64>().prop_map(|seed| Operation::DrawAudits { seed }),
    ]
}
