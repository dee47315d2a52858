//! Copies that are cut short at random instants, again and again.

use crate::contents::{self, Contents};
use crate::draws::{Draws, seed};
use crate::place::Place;
use crate::process::Process;
use crate::s3::Server;
use std::process::Stdio;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// In each of three directions.
const KILLS: u32 = 4;

/// Copies `from` into fresh targets, killing the command at random instants, until it was killed
/// often enough; the last target is let be finished. What `target` gives is a store and options.
fn interrupt(
    place: &Place,
    from: &str,
    draws: &mut Draws,
    mut target: impl FnMut() -> (String, String),
) -> String {
    let (undisturbed, options) = target();
    let began = Instant::now();
    place.succeed(&format!("store migrate {from} {undisturbed} {options}"));
    let takes = began.elapsed();
    let (mut to, mut options) = target();
    let (mut kills, mut targets, mut began_with) = (0, 1, 0);
    loop {
        let arguments = format!("store migrate {from} {to} {options}");
        let mut command = place.command(&arguments);
        let mut process = Process::spawn(command.stdout(Stdio::null()));
        thread::sleep(takes.mul_f64(draws.below(1000) as f64 / 1000.0));
        if !process.has_ended() {
            process.kill();
            kills += 1;
            continue;
        }
        let status = process.ended(Duration::from_secs(1));
        assert_eq!(status.code(), Some(0), "after {kills} kills");
        if kills >= KILLS {
            println!("{from}: {kills} kills, {targets} targets, {takes:.2?} undisturbed");
            return to;
        }
        assert!(
            kills > began_with || targets < 100,
            "nothing is ever cut short"
        );
        began_with = kills;
        (to, options) = target();
        targets += 1;
    }
}

#[test]
fn a_copy_that_is_killed_at_any_instant_goes_on_and_ends_equal() {
    let mut place = Place::new(contents::MATERIALS);
    let server = Server::start(&place.path().join("s3"));
    place.environment = server.environment();
    let expected: Contents = contents::make(&place.path().join("first"));
    let mut draws = Draws(seed());
    let mut number = 0;
    let place = &place;
    let mut next = |options: &str| {
        number += 1;
        (
            format!("copy{number}"),
            options.replace('N', &number.to_string()),
        )
    };

    let database = interrupt(place, "first", &mut draws, || {
        let (_, options) = next("--blobs imagesN");
        (place.database(), options)
    });
    let bucket = interrupt(place, &database, &mut draws, || next("--blobs s3://farm/N"));
    assert_eq!(contents::read(place, &bucket), expected);
    let folder = interrupt(place, &bucket, &mut draws, || next(""));
    assert_eq!(contents::read(place, &folder), expected);
    let log = fs::read_to_string(place.path().join(folder).join("completions.log")).expect("a log");
    assert_eq!(log.lines().count(), contents::COMPLETE as usize, "{log}");
}
