//! How the server goes about what it is asked most.

use super::make;
use crate::testing::{client, fresh_schema};

/// The statements of claims, renewals and completions, and of calls that come as often; each with
/// the tables that it may read from end to end because they have one row, or one a shard.
const HOT: [(&str, &str); 22] = [
    ("askers", include_str!("../sql/askers.sql")),
    ("counts", include_str!("../sql/counts.sql")),
    ("claimed_before", include_str!("../sql/claimed_before.sql")),
    ("redundant", include_str!("../sql/redundant.sql")),
    ("fresh", include_str!("../sql/fresh.sql")),
    ("again", include_str!("../sql/again.sql")),
    ("finished", include_str!("../sql/finished.sql")),
    ("jobs_locked", include_str!("../sql/jobs_locked.sql")),
    ("jobs", include_str!("../sql/jobs.sql")),
    ("leases_locked", include_str!("../sql/leases_locked.sql")),
    ("write_jobs", include_str!("../sql/write_jobs.sql")),
    ("write_leases", include_str!("../sql/write_leases.sql")),
    ("renew_leases", include_str!("../sql/renew_leases.sql")),
    ("end_leases", include_str!("../sql/end_leases.sql")),
    (
        "write_completions",
        include_str!("../sql/write_completions.sql"),
    ),
    ("write_images", include_str!("../sql/write_images.sql")),
    ("failing", include_str!("../sql/failing.sql")),
    ("name", include_str!("../sql/name.sql")),
    ("seen", include_str!("../sql/seen.sql")),
    ("places", include_str!("../sql/places.sql")),
    ("held_by_worker", include_str!("../sql/held_by_worker.sql")),
    ("vouched", include_str!("../sql/vouched.sql")),
];

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_hot_statement_goes_by_an_index() {
    let url = fresh_schema().await;
    make(&url, 60_000).await;
    let client = client(&url).await;
    client
        .batch_execute(
            "UPDATE jobs SET stage = 'completed', renderer = 'w' || material % 50, record = '{}', \
                 judge_wanted = material % 100 = 0 WHERE material < 30000; \
             UPDATE jobs SET stage = 'leased' WHERE material BETWEEN 30000 AND 34999; \
             UPDATE jobs SET failed_on = '{w1}' WHERE material % 1000 = 0; \
             INSERT INTO leases SELECT material, '\\x00', int8send(material % 50), \
                 'w' || material % 50, 0, 0, 0, 0 FROM jobs WHERE stage = 'leased'; \
             INSERT INTO sessions SELECT int8send(n), 'w' || n, 0 FROM generate_series(0, 4999) n; \
             INSERT INTO workers SELECT 'w' || n, false, false, NULL, '{}' \
                 FROM generate_series(0, 4999) n; \
             INSERT INTO completions SELECT material, '{}' FROM jobs WHERE stage = 'completed'; \
             INSERT INTO images SELECT int8send(material), material, 0, 0 FROM jobs \
                 WHERE stage = 'completed'; \
             SET plan_cache_mode = force_generic_plan; SET jit = off",
        )
        .await
        .unwrap();
    client.batch_execute("VACUUM ANALYZE").await.unwrap();
    for (name, statement) in HOT {
        client
            .batch_execute(&format!("PREPARE {name} AS {statement}"))
            .await
            .unwrap();
        let parameters = client
            .query_one(
                "SELECT cardinality(parameter_types) FROM pg_prepared_statements WHERE name = $1",
                &[&name],
            )
            .await
            .unwrap();
        let parameters = vec!["NULL"; parameters.get::<_, i32>(0) as usize].join(", ");
        let arguments = match parameters.as_str() {
            "" => String::new(),
            some => format!("({some})"),
        };
        let explained = client
            .query(&format!("EXPLAIN EXECUTE {name}{arguments}"), &[])
            .await
            .unwrap();
        let plan: Vec<&str> = explained.iter().map(|row| row.get(0)).collect();
        let plan = plan.join("\n");
        for table in ["jobs", "leases", "completions", "images", "workers"] {
            let whole = format!("Seq Scan on {table}");
            assert!(!plan.contains(&whole), "{name}:\n{plan}");
        }
    }
}
