-- Views over the tables of an archive. Levels: 0 OK, 1 WARN, 2 ERROR, 3 STALE. store.py inserts the
-- names of levels, events, verdicts and reasons.
CREATE VIEW latest_health AS SELECT * FROM units;

-- Units sorted from worst to best: by level (ERROR, WARN, STALE, OK), then by the median of the
-- remaining life, then by health index.
CREATE VIEW worst_first AS
SELECT
    model, actuator_id, serial_number, $level_names[level + 1] AS health,
    $level_names[last_level + 1] AS last_health, dominant_fault, health_index, rul, removal_hours, flight_hours, tested,
    reason
FROM units
ORDER BY
    CASE level WHEN 3 THEN 0.5 ELSE level END DESC,
    CASE WHEN rul.known THEN rul.hours_50 ELSE 'inf'::DOUBLE END,
    health_index, model, unit;


-- An alarm is a run of consecutive tests in WARN or ERROR. An alarm is false if it ended without a
-- repair of the unit and without a step of a fault.
CREATE VIEW alarms AS
WITH marked AS (
    SELECT
        *, level IN (1, 2) AS is_alarm,
        count(*) FILTER (WHERE level NOT IN (1, 2))
            OVER (PARTITION BY model, unit ORDER BY tested_ns) AS quiet_before
    FROM health
),
ends AS (
    SELECT
        *, lead(events) OVER tests AS next_events, lead(tested_ns) OVER tests AS next_ns
    FROM marked
    WINDOW tests AS (PARTITION BY model, unit ORDER BY tested_ns)
)
SELECT
    model, unit, any_value(actuator_id) AS actuator_id, any_value(serial_number) AS serial_number,
    min(tested) AS began, max(tested) AS last_test, count(*) AS tests, max(level) AS level,
    arg_max(dominant_fault, level) AS dominant_fault,
    last(next_ns ORDER BY tested_ns) IS NOT NULL AS is_over,
    coalesce(len(list_filter(last(next_events ORDER BY tested_ns),
        lambda event: event.kind IN ('$repair', '$step'))) > 0, false) AS was_repaired
FROM ends WHERE is_alarm GROUP BY model, unit, quiet_before;

CREATE VIEW false_alarms AS
SELECT * FROM alarms WHERE is_over AND NOT was_repaired ORDER BY began, model, unit;

-- Windows that are in several bags, for example in copies of a bag. Health and life use one copy.
CREATE VIEW copies AS
SELECT model, unit, end_ns, any_value(tested) AS tested, list(bag ORDER BY bag) AS bags
FROM estimates GROUP BY model, unit, end_ns
HAVING count(*) > 1 AND count(DISTINCT fitness) <= 1 ORDER BY model, unit, end_ns;

-- Bags that cannot be read or have no window, and windows that are refused, with the codes of their
-- reasons. Reasons of bags have no codes: `message` is their text without names and numbers.
CREATE VIEW refused AS
SELECT bag, NULL::INTEGER AS number, NULL::TIMESTAMP AS tested, state AS what, []::VARCHAR[] AS codes, reason,
    regexp_replace(replace(reason, bag, 'BAG'), '-?\b[0-9]+([.][0-9]+)?(e[-+]?[0-9]+)?', '#', 'g') AS message
FROM bags WHERE state <> 'new' AND reason <> ''
UNION ALL
SELECT bag, number, tested, verdict AS what, list_sort(list_distinct([item.code FOR item IN reasons])) AS codes,
    reason, NULL AS message
FROM estimates WHERE NOT valid
UNION ALL
SELECT bag, number, tested, '$refused' AS what, ['$stamps_contradict'] AS codes, reason, NULL AS message
FROM unordered;

-- Number of refusals by the codes of their reasons, and of bags by their message, with an example.
CREATE VIEW refused_why AS
SELECT
    what, codes, arg_min(reason, (bag, number)) AS reason, count(*) AS count, min(bag) AS for_instance
FROM refused GROUP BY what, codes, message ORDER BY count DESC, what, codes, message;

-- Runs to failure, as training data for other methods of prognosis. A repair starts a new life of a
-- unit, and a life ends with its first test in ERROR, by the limits of the archive. hours_left is
-- NULL for a life that has not ended.
CREATE VIEW runs_to_failure AS
WITH lives AS (
    SELECT
        *, count(*) FILTER (WHERE len(list_filter(events, lambda event: event.kind = '$repair')) > 0)
            OVER (PARTITION BY model, unit ORDER BY tested_ns) AS life
    FROM health
),
ends AS (
    SELECT model, unit, life, min(flight_hours) FILTER (WHERE level = 2) AS end_hours
    FROM lives GROUP BY model, unit, life
)
SELECT
    model, unit, life, lives.cycles, lives.flight_hours, lives.level,
    estimates.friction, estimates.friction_sigma, estimates.backlash, estimates.backlash_sigma,
    estimates.short_circuit_a, estimates.short_circuit_a_sigma, estimates.short_circuit_b, estimates.short_circuit_b_sigma,
    estimates.short_circuit_c, estimates.short_circuit_c_sigma, estimates.eccentricity, estimates.eccentricity_sigma,
    estimates.eccentricity_phase, estimates.eccentricity_phase_sigma, estimates.gain, estimates.gain_sigma,
    end_hours,
    CASE WHEN end_hours IS NOT NULL THEN greatest(end_hours - lives.flight_hours, 0) END AS hours_left
FROM lives
JOIN ends USING (model, unit, life)
JOIN estimates USING (model, unit)
ANTI JOIN unordered USING (bag, number)
WHERE estimates.valid AND estimates.end_ns = lives.tested_ns
QUALIFY row_number() OVER (PARTITION BY model, unit, estimates.end_ns ORDER BY estimates.bag) = 1
ORDER BY model, unit, lives.tested_ns;
