"""Scenario files: each mistake is named with its key, its value and what is expected."""

import re
from pathlib import Path

import pytest

from ema_monitor.prognosis.duty.scenario import Scenario, read_scenarios

WHOLE = """
scenarios:
  - name: as flown
  - name: training
    duty: 1.2
    travel_per_hour: 120
    loads: {0.1: 0.8, 0.6: 0.2}
    winding: {60: 0.7, 110: 0.3}
    hours_per_cycle: 2.5
    hours_per_day: 6
"""


def read(folder: Path, content: str) -> tuple[Scenario, ...]:
    path = folder / "scenarios.yaml"
    path.write_text(content)
    return read_scenarios(path)


def test_file_has_a_scenario_each(tmp_path):
    flown, training = read(tmp_path, WHOLE)
    assert flown == Scenario("as flown")
    assert training == Scenario(
        "training", 1.2, 120.0, {0.1: 0.8, 0.6: 0.2}, {60: 0.7, 110: 0.3}, 2.5, 6.0
    )


def test_example_in_the_documents_is_read(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "prognosis.md").read_text(encoding="utf-8")
    [example] = re.findall(r"^```yaml\n(scenarios:.*?)^```$", text, re.DOTALL | re.MULTILINE)
    flown, training = read(tmp_path, example)
    assert flown == Scenario("as flown")
    assert training.hours_per_day == 6.0


@pytest.mark.parametrize(
    ("row", "texts"),
    [
        ("{}", ["name = ''", "1 to 64 printable"]),
        ("{name: 3}", ["name = 3", "expected a text"]),
        (f"{{name: {'a' * 65}}}", ["name = ", "1 to 64"]),
        ("{name: a, duty: 0}", ["duty = 0", "[0.001, 1000]"]),
        ("{name: a, duty: fast}", ["duty = 'fast'", "[0.001, 1000]"]),
        ("{name: a, travel_per_hour: -1}", ["travel_per_hour = -1 rad/h", "[0, 1e+07]"]),
        ("{name: a, travel_per_hour: .nan}", ["travel_per_hour = nan", "[0, 1e+07]"]),
        ("{name: a, hours_per_day: 25}", ["hours_per_day = 25 h/d", "[0, 24]"]),
        ("{name: a, hours_per_cycle: -2}", ["hours_per_cycle = -2 h", "[0, 1e+06]"]),
        ("{name: a, loads: 0.3}", ["loads = 0.3", "values with shares"]),
        ("{name: a, loads: {0.1: 0.5}}", ["loads", "sum to 0.5", "expected 1"]),
        ("{name: a, loads: {-0.1: 1}}", ["loads", "-0.1", "[0, 10]"]),
        ("{name: a, loads: {high: 1}}", ["loads", "'high'", "[0, 10]"]),
        ("{name: a, loads: {0.1: 2}}", ["loads", "share 2 at 0.1", "[0, 1]"]),
        ("{name: a, winding: {900: 1}}", ["winding", "900", "[-60, 300] degC"]),
        ("{name: a, travel: 3}", ["unknown key 'travel'", "travel_per_hour"]),
        ("a", ["scenario 2 = a", "keys with values"]),
    ],
)
def test_wrong_scenario_is_refused_by_name(tmp_path, row: str, texts: list[str]):
    with pytest.raises(ValueError, match="scenario 2") as refused:
        read(tmp_path, f"scenarios: [{{name: right}}, {row}]")
    assert all(text in str(refused.value) for text in ["scenarios.yaml", *texts]), refused.value


@pytest.mark.parametrize(
    ("content", "texts"),
    [
        ("", ["None", "expected one key, scenarios"]),
        ("[1, 2]", ["[1, 2]", "expected one key, scenarios"]),
        ("duties: []", ["duties", "expected one key, scenarios"]),
        ("scenarios: []", ["scenarios = []", "a list of at least one"]),
        ("scenarios: {name: a}", ["scenarios = ", "a list of at least one"]),
        ("scenarios: [{name: a}, {name: a}]", ["name = 'a'", "expected once", "2 times"]),
        (f"scenarios: [{', '.join(f'{{name: s{n}}}' for n in range(21))}]", ["21", "at most 20"]),
        ("scenarios: [{name: a, name: b}]", ["name is given twice"]),
        ("scenarios: [", ["is not a YAML file"]),
    ],
)
def test_wrong_file_is_refused(tmp_path, content: str, texts: list[str]):
    with pytest.raises(ValueError, match=r"scenarios\.yaml") as refused:
        read(tmp_path, content)
    assert all(text in str(refused.value) for text in texts), refused.value
