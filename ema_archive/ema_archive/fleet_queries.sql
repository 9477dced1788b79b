-- Queries of a fleet summary, each under its name. Levels: 0 OK, 1 WARN, 2 ERROR, 3 STALE.

-- name: bags
SELECT
    count(*) AS bags, count(*) FILTER (WHERE state = 'damaged' AND is_there) AS damaged,
    count(*) FILTER (WHERE state = 'incomplete' AND is_there) AS incomplete,
    count(*) FILTER (WHERE state = 'failed' AND is_there) AS failed,
    count(*) FILTER (WHERE state IN ('new', 'lost')) AS unread,
    -- Bags that cannot be assigned to a unit come first.
    (SELECT coalesce(list(bag), []) FROM (
        SELECT bag FROM manifest.unread LEFT JOIN (
            SELECT DISTINCT bag, true AS is_suspect FROM manifest.suspect
        ) USING (bag)
        WHERE state <> 'incomplete' ORDER BY is_suspect NULLS FIRST, bag LIMIT 3
    )) AS unreadable
FROM bags;

-- name: levels
SELECT
    count(*) AS units, max(tested) AS latest_test,
    count(*) FILTER (WHERE level = 0) AS ok, count(*) FILTER (WHERE level = 1) AS warn,
    count(*) FILTER (WHERE level = 2) AS error, count(*) FILTER (WHERE level = 3) AS stale,
    median(health_index) FILTER (WHERE isfinite(health_index)) AS health_index
FROM units;

-- name: worst
SELECT * FROM worst_first LIMIT $most;

-- name: models
SELECT
    model, count(*) AS units,
    count(*) FILTER (WHERE level = 0) AS ok, count(*) FILTER (WHERE level = 1) AS warn,
    count(*) FILTER (WHERE level = 2) AS error, count(*) FILTER (WHERE level = 3) AS stale,
    median(health_index) FILTER (WHERE isfinite(health_index)) AS health_index,
    median(rul.hours_50) FILTER (WHERE rul.known) AS rul_50,
    median(flight_hours) FILTER (WHERE isfinite(flight_hours)) AS flight_hours
FROM units GROUP BY model ORDER BY error DESC, warn DESC, model LIMIT $most;

-- name: ages
-- At most twelve classes of service hours of equal width, which is 1, 2 or 5 times a power of ten.
WITH known AS (SELECT * FROM units WHERE isfinite(flight_hours) AND flight_hours >= 0),
longest AS (SELECT greatest(max(flight_hours), 1) / 10 AS least FROM known),
power AS (SELECT least, pow(10, floor(log10(least))) AS ten FROM longest),
classes AS (
    SELECT ten * CASE
        WHEN least <= ten THEN 1 WHEN least <= 2 * ten THEN 2 WHEN least <= 5 * ten THEN 5
        ELSE 10 END AS width
    FROM power
)
SELECT
    width * floor(flight_hours / width) AS from_hours, width * floor(flight_hours / width) + width AS to_hours,
    count(*) AS units,
    count(*) FILTER (WHERE level = 0) AS ok, count(*) FILTER (WHERE level = 1) AS warn,
    count(*) FILTER (WHERE level = 2) AS error, count(*) FILTER (WHERE level = 3) AS stale,
    median(health_index) FILTER (WHERE isfinite(health_index)) AS health_index
FROM known, classes GROUP BY ALL ORDER BY from_hours;

-- name: lives
SELECT from_age, to_age, has_failed FROM lives;

-- name: calibrations
-- Age of a calibration: time from its last modification to the latest test of the unit.
WITH aged AS (
    SELECT CASE WHEN calibrated IS NOT NULL THEN greatest(epoch(tested - calibrated), 0) / 86400 END
        AS days
    FROM units
)
SELECT
    CASE
        WHEN days IS NULL THEN 'no date' WHEN days < 30 THEN 'below 30 days'
        WHEN days < 90 THEN '30 to 90 days' WHEN days < 180 THEN '90 to 180 days'
        WHEN days < 365 THEN '180 to 365 days' ELSE '365 days or more' END AS age,
    count(*) AS units, max(days) AS longest_days
FROM aged GROUP BY age ORDER BY longest_days NULLS LAST;

-- name: recent
-- Number of units tested within some days before the latest test of the fleet.
SELECT days, count(*) FILTER (WHERE tested >= latest - to_days(days)) AS tested, count(*) AS units
FROM units, (SELECT max(tested) AS latest FROM units), (SELECT unnest([1, 7, 30, 90]) AS days)
GROUP BY days ORDER BY days;

-- name: months
-- A unit counts as known from the month of its first test.
WITH firsts AS (SELECT model, unit, min(month) AS month FROM months GROUP BY ALL),
begun AS (SELECT month, count(*) AS begun FROM firsts GROUP BY month),
tested AS (
    SELECT month, count(*) AS tested, sum(windows) AS windows, sum(valid) AS valid
    FROM months GROUP BY month
)
SELECT
    month, tested, sum(coalesce(begun, 0)) OVER (ORDER BY month)::BIGINT AS units,
    windows::BIGINT AS windows, valid::BIGINT AS valid
FROM tested LEFT JOIN begun USING (month) ORDER BY month DESC LIMIT 36;
