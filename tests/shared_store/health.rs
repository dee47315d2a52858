//! What the health service says of a coordinator whose database goes and comes.

use crate::place::Place;
use crate::server::Server;
use std::thread::sleep;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// How soon health has to tell that the database is away.
const TOLD_WITHIN: Duration = Duration::from_secs(5);

/// How long it takes until health says so, by the command's exit code.
fn until(place: &Place, coordinator: &str, serves: bool, most: Duration) -> Duration {
    let began = Instant::now();
    let wanted = Some(i32::from(!serves));
    let ask = format!("coordinator health --coordinator {coordinator}");
    while place.run(&ask).status.code() != wanted {
        assert!(began.elapsed() < most, "no word of serving: {serves}");
        sleep(Duration::from_millis(50));
    }
    began.elapsed()
}

#[test]
fn health_tells_that_the_database_is_away_and_that_it_is_back() {
    let place = Place::new(4);
    let mut server = Server::start("");
    server.wait();
    let runtime = Runtime::new().expect("a runtime");
    let database = runtime.block_on(crate::server::schema_in(&server.url(), 0));
    let (coordinator, url) = place.coordinator(&database, "--blobs images");
    until(&place, &url, true, TOLD_WITHIN);
    server.kill();
    let told = until(&place, &url, false, TOLD_WITHIN);
    println!(
        "told after {:.1} s that the database is away",
        told.as_secs_f64()
    );
    // Which is no reason to start the coordinator again.
    place.succeed(&format!("coordinator health --alive --coordinator {url}"));
    server.restart();
    server.wait();
    until(&place, &url, true, Duration::from_secs(30));
    coordinator.kill();
}
