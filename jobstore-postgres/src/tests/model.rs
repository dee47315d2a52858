//! The suite of every job store, over PostgreSQL.

use super::{PresenceLimits, job_store, make};
use crate::testing::{fresh_schema, run};
use jobstore::{
    JobStore, Overview,
    model::{MATERIALS, POLICY, Place, follow, operation, runs},
};
use proptest::prelude::*;
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

/// A schema with a clock that stands until it is told.
#[derive(Default)]
struct PostgresPlace {
    url: Option<String>,
    now: Duration,
}

/// The database's clock when the suite's is at zero: leases before it have to be possible.
const START: Duration = Duration::from_secs(1_000_000);

/// Sets the database's clock. The sweep ran without a gap until then.
fn tell_time(now: Duration) -> String {
    let now = (START + now).as_millis();
    format!(
        "CREATE OR REPLACE FUNCTION now_ms() RETURNS bigint LANGUAGE sql VOLATILE AS \
             'SELECT {now}::bigint'; \
         UPDATE sweeps SET swept_ms = {now};"
    )
}

#[async_trait::async_trait]
impl Place for PostgresPlace {
    async fn open(&mut self, overview: Arc<Mutex<Overview>>) -> Arc<dyn JobStore> {
        if self.url.is_none() {
            let url = fresh_schema().await;
            make(&url, MATERIALS).await;
            run(&url, &tell_time(self.now)).await;
            self.url = Some(url);
        }
        let url = self.url.as_ref().unwrap();
        // Nobody was there for long: workers are gone, and leases begin again.
        run(url, "DELETE FROM sessions; UPDATE sweeps SET swept_ms = 0").await;
        let presence = PresenceLimits {
            idle_pause: Duration::ZERO,
            dismissed_after: Duration::ZERO,
            forgotten_after: START,
        };
        let job_store = job_store(url, POLICY, presence, overview);
        job_store.expire().await.unwrap();
        job_store
    }

    async fn set_time(&mut self, now: Duration) {
        self.now = now;
        if let Some(url) = &self.url {
            run(url, &tell_time(now)).await;
        }
    }

    fn knows_next_expiry(&self) -> bool {
        false
    }
}

proptest! {
    #![proptest_config(runs(8))]

    #[test]
    fn the_job_store_over_postgres_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(Box::<PostgresPlace>::default(), operations);
    }
}

/// Runs of 200 to 300 operations, 100,000 and more, unless BRDFARM_MODEL_RUNS says otherwise.
fn runs_long() -> u32 {
    let given = std::env::var("BRDFARM_MODEL_RUNS").ok();
    given.map_or(512, |given| given.parse().expect("a number"))
}

proptest! {
    #![proptest_config(runs(runs_long()))]

    #[test]
    #[ignore = "an hour: tests/postgres.sh"]
    fn the_job_store_over_postgres_does_what_the_model_does_for_long(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(Box::<PostgresPlace>::default(), operations);
    }
}
