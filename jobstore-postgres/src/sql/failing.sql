-- Those who hold these leases and whose completion changes what is kept of them: a row of failures
-- ends, a newcomer is one completion older, work that was audited grows.
SELECT leases.name FROM leases
    LEFT JOIN workers AS worker ON worker.name = leases.name
    LEFT JOIN workers AS answers ON answers.name = identity(leases.name)
WHERE leases.material = ANY ($1) AND (
    coalesce(worker.failing, false)
    OR coalesce(answers.probation, 0) < $2
    OR $3 AND NOT coalesce(answers.audit_due, false)
)
