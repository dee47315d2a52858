UPDATE jobs
SET stage = new.stage::stage, priority = new.priority, judge_wanted = new.judge_wanted,
    renderer = new.renderer, contradictor = new.contradictor,
    failed_on = string_to_array(new.failed_on, chr(31)), record = new.record
FROM unnest(
    $1::bigint[], $2::text[], $3::integer[], $4::boolean[], $5::text[], $6::text[], $7::text[], $8::text[]
) AS new (material, stage, priority, judge_wanted, renderer, contradictor, failed_on, record)
WHERE jobs.material = new.material
