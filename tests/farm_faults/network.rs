//! Networks that lose, delay, reorder and die without a word.

use crate::harness::{Harness, patience, wait_for};
use crate::proxy::Proxy;
use std::thread;
use std::time::Duration;

#[test]
fn a_network_that_delays_swallows_and_breaks_changes_nothing() {
    let mut harness = Harness::new(8, 64);
    harness.start();
    let proxy = Proxy::before(&harness.address);
    let far = harness.worker("far", &proxy.address);
    wait_for("a completion", || !harness.completed().is_empty());
    proxy.delay(Duration::from_millis(30));
    let before = harness.completed().len();
    wait_for("a slow completion", || harness.completed().len() > before);
    proxy.cut(true);
    wait_for("lost leases", || harness.status()["leases_lost"] != 0);
    proxy.cut(false);
    let before = harness.completed().len();
    wait_for("a completion after the cut", || {
        harness.completed().len() > before
    });
    proxy.delay(Duration::ZERO);
    // Longer than a lease; shorter than it takes to see that the connection is dead.
    proxy.swallow(true);
    thread::sleep(Duration::from_secs(3));
    proxy.swallow(false);
    proxy.cut(true);
    proxy.cut(false);
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_eq!(far.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// The completion is durable and its answer is lost: the worker asks again, and hears that it is
/// done.
#[test]
fn an_answer_that_is_lost_is_asked_for_again_and_counts_once() {
    const MATERIALS: u32 = 6;
    let mut harness = Harness::new(MATERIALS, 16);
    // The answer to a call for work can be lost too: that lease has to run out.
    harness.lease_seconds = 5;
    harness.start();
    let proxy = Proxy::before(&harness.address);
    let far = harness.worker("far", &proxy.address);
    for _ in 0..3 {
        wait_for("what was completed to be heard of", || {
            harness.acknowledged().len() == harness.completed().len()
        });
        proxy.delay(Duration::from_millis(200));
        let before = harness.completed().len();
        wait_for("a completion", || harness.completed().len() > before);
        // Its answer waits here.
        proxy.cut(true);
        proxy.cut(false);
        proxy.delay(Duration::ZERO);
    }
    harness.wait_until_finished();
    assert_eq!(far.ended(patience()).code(), Some(0));
    let mut heard = harness.acknowledged();
    heard.sort_unstable();
    let all: Vec<u64> = (0..u64::from(MATERIALS)).collect();
    assert_eq!(heard, all, "a completion was not heard of, or twice");
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// Connections are reordered: what the worker said on one arrives after what it says, and says
/// again, on the next.
#[test]
fn words_that_arrive_late_and_out_of_order_change_nothing() {
    // Enough that some are left for the last round, however slow this machine is at looking.
    let mut harness = Harness::new(60, 64);
    harness.start();
    let proxy = Proxy::before(&harness.address);
    let far = harness.worker("far", &proxy.address);
    for _ in 0..3 {
        let before = harness.completed().len();
        wait_for("a completion", || harness.completed().len() > before);
        let late = proxy.late_pieces();
        proxy.delay(Duration::from_secs(1));
        wait_for("words under way", || proxy.waiting() > 0);
        proxy.overtake();
        wait_for("words that come late", || proxy.late_pieces() > late);
    }
    harness.wait_until_finished();
    assert_eq!(harness.status()["set_aside"], 0);
    assert_eq!(far.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}

/// Nothing closes the connection, and nothing comes through any more: probes and deadlines find
/// that out, and the worker takes another connection.
#[test]
#[ignore = "waits most of a minute: tests/campaign.sh runs it"]
fn a_connection_that_dies_without_a_word_is_given_up() {
    let mut harness = Harness::new(6, 64);
    harness.start();
    let proxy = Proxy::before(&harness.address);
    let far = harness.worker("far", &proxy.address);
    wait_for("a completion", || !harness.completed().is_empty());
    proxy.deaden();
    harness.wait_until_finished();
    assert_eq!(far.ended(patience()).code(), Some(0));
    harness.kill_coordinator();
    harness.expect_undisturbed();
}
