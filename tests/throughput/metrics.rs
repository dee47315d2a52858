//! What the coordinator's metrics tell.

/// The upper end of the histogram's bucket that holds a quantile of a call's times.
pub fn bucket_ms(metrics: &str, call: &str, quantile: f64) -> f64 {
    let wanted = format!("call=\"{call}\"");
    let buckets: Vec<(f64, f64)> = metrics
        .lines()
        .filter(|line| line.starts_with("brdfarm_call_seconds_bucket") && line.contains(&wanted))
        .map(|line| {
            let edge = line.split("le=\"").nth(1).unwrap().split('"').next();
            let count = line.rsplit(' ').next().unwrap();
            let edge = edge.unwrap().parse().unwrap_or(f64::INFINITY);
            (edge, count.parse().unwrap())
        })
        .collect();
    let all = buckets.iter().map(|bucket| bucket.1).fold(0.0, f64::max);
    let holds = buckets.iter().find(|bucket| bucket.1 >= quantile * all);
    holds.unwrap().0 * 1e3
}

/// How many of something the coordinator did, and how long each took.
pub fn told(metrics: &str, what: &str) -> String {
    let read = |end: &str| {
        let name = format!("brdfarm_{what}_seconds_{end} ");
        let line = metrics.lines().find_map(|line| line.strip_prefix(&name));
        line.unwrap().parse::<f64>().unwrap()
    };
    let count = read("count");
    let mean_ms = read("sum") / count * 1e3;
    format!("{count} of {what}, {mean_ms:.1} ms on average")
}
