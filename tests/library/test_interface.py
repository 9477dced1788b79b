# SPDX-License-Identifier: Apache-2.0
"""The packages as libraries: their public names and the modules that they import."""

import ast
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pandas
import pytest

import ema_bags
import ema_core
import ema_monitor
import ema_sim
from ema_core.faults import FAULTS, FaultVector
from ema_core.wording import text_table
from ema_monitor.plot import plot_fit
from ema_monitor.prognosis.outlook import outlook_of_one
from ema_monitor.recordings import read_windows

from ..commands import SAMPLE

TRUTH = {"friction": 0.25, "eccentricity": 0.1}


@pytest.fixture(scope="module")
def window() -> ema_monitor.Window:
    [recorded] = ema_monitor.find_windows(ema_sim.simulate(TRUTH, seed=1))
    return recorded


@pytest.fixture(scope="module")
def estimate(window) -> ema_monitor.Estimate:
    return ema_monitor.identify(window)


def test_named_vector_has_the_components_of_the_registry_in_their_order():
    assert FaultVector._fields == tuple(fault.name for fault in FAULTS)
    vector = FaultVector.of(np.arange(8))
    assert (vector.backlash, vector[1], np.asarray(vector).shape) == (1.0, 1.0, (8,))


def test_estimate_that_is_refused_prints_why(window):
    unit = ema_sim.ActuatorDescription(serial_number="another")
    refused = ema_monitor.identify(window, unit)
    assert str(refused).startswith("no valid estimate: the calibration does not fit")


def test_estimates_make_a_table(estimate):
    table = pandas.DataFrame([estimate.as_row(), estimate.as_row()])
    assert table.friction.tolist() == [estimate.faults.friction] * 2
    assert table.friction_sigma.dtype == np.float64
    assert table.valid.all()
    assert table.verdict.tolist() == [estimate.verdict] * 2


def test_recorded_windows_equal_the_windows_in_the_telemetry():
    recorded = read_windows(SAMPLE)
    [window] = recorded.usable
    assert str(recorded).splitlines()[1].endswith("usable")
    [again] = ema_monitor.find_windows(ema_bags.read_telemetry(SAMPLE))
    assert (again.start_ns, again.play) == (window.start_ns, window.play)
    np.testing.assert_array_equal(again.current, window.current)


def test_stretch_that_cannot_be_used_gives_a_warning():
    telemetry = ema_sim.simulate()
    with pytest.warns(UserWarning, match="the telemetry ends"):
        assert ema_monitor.find_windows(telemetry.part(0, 9000)) == []


def test_calibration_prints_its_windows_and_lift():
    windows = ema_monitor.find_windows(ema_sim.simulate(cycles=2, current_noise=0.02))
    assert "from 2 windows, lift 0.1" in str(ema_monitor.calibrate(windows))


def test_simulated_cycles_are_at_least_one():
    with pytest.raises(ValueError, match="cycles = 0: expected a whole number of at least 1"):
        ema_sim.simulate(cycles=0)


def test_tracked_estimates_predict_a_remaining_life(window, estimate):
    tracker = ema_monitor.track([estimate, estimate], [0.0, 10.0])
    prognosis = tracker.predict()
    assert prognosis.hours == 10.0
    rows = prognosis.as_rows()
    assert [row["criterion"] for row in rows][-1] == prognosis.overall.criterion
    assert str(prognosis).splitlines()[0].startswith("remaining useful life")


def test_picture_of_a_fit_shows_current_and_speed_measured_and_modelled(window, estimate):
    current, residual, speed, *_ = plot_fit(window, estimate).axes
    for axes, measured in ((current, window.current), (speed, window.telemetry.speed[1:])):
        assert [line.get_label() for line in axes.lines] == [
            "measured",
            "model, healthy",
            "model, estimated faults",
        ]
        assert np.array_equal(axes.lines[0].get_ydata(), measured)
    rest = np.asarray(current.lines[0].get_ydata()) - np.asarray(current.lines[2].get_ydata())
    assert np.array_equal(residual.lines[0].get_ydata(), rest)


def test_wrong_arguments_are_refused_with_the_type_that_is_expected(window, estimate):
    telemetry = window.telemetry
    wrong: Any
    for wrong in (np.zeros((5, 100)), "log.csv", 3.0, [np.zeros(5)]):
        with pytest.raises(ValueError, match="expected Telemetry: "):
            ema_monitor.find_windows(wrong)
    for wrong in (telemetry, [window], telemetry.current):
        with pytest.raises(ValueError, match=r"expected Window or Refusal: find_windows"):
            ema_monitor.identify(wrong)
    public, settings = ema_monitor, ema_monitor.SearchSettings()
    monitor, trigger = ema_monitor.Monitor(), ema_monitor.TriggerSettings()
    flap, sine = ema_sim.ActuatorDescription(), ema_sim.Command("sine")
    calibration, combining = public.Calibration.builtin(), public.CombinationSettings()
    limits = ema_monitor.MotionLimits.within(flap.parameters, travel=0.03)
    calls: list[tuple[str, Callable[[Any], Any], tuple[Any, ...]]] = [
        ("description is of type", lambda x: public.find_windows(telemetry, x), (3, settings)),
        ("settings is of type", lambda x: public.find_windows(telemetry, None, x), (3, settings)),
        ("returns windows$", public.calibrate, (telemetry, [telemetry], 3)),
        ("description is of type", lambda x: public.calibrate([window], x), (3, settings)),
        (
            "calibration is of type",
            lambda x: public.identify(window, calibration=x),
            (3, telemetry),
        ),
        ("description is of type", lambda x: public.identify(window, x), (3, settings)),
        ("settings is of type", lambda x: public.identify(window, settings=x), (3, telemetry)),
        ("calibration is of type", lambda x: public.identify_motion(telemetry, None, x), (3,)),
        ("settings is of type", lambda x: public.identify_motion(telemetry, None, None, x), (3,)),
        (
            "measured is of type",
            lambda x: public.identify_motion(telemetry, measured=x),
            (3, [1], 0),
        ),
        ("estimates is of type", lambda x: public.track(x, [1.0]), (estimate, 3)),
        ("hours is of type", lambda x: public.track([estimate], x), (1.0,)),
        ("limits is of type", lambda x: public.track([], [], x), (3, settings)),
        ("estimate is of type", lambda x: public.assess(x, public.HealthLimits()), (3, window)),
        ("limits is of type", lambda x: public.assess(estimate, x), (3, settings)),
        ("description is of type", public.Monitor, (3, settings)),
        ("settings is of type", lambda x: public.Monitor(settings=x), (3, settings)),
        ("history is of type", public.Unit, (3, estimate)),
        ("description is of type", lambda x: public.Combination(x, calibration), (3, calibration)),
        ("calibration is of type", lambda x: public.Combination(flap, x), (3, flap)),
        ("search is of type", lambda x: public.Combination(flap, calibration, x), (combining,)),
        (
            "settings is of type",
            lambda x: public.Combination(flap, calibration, settings=x),
            (settings,),
        ),
        ("history_folder is of type", lambda x: public.Monitor(history_folder=x), (3, b"x")),
        ("path is of type", lambda x: public.History("flap", "1", x), (3,)),
        ("path is of type", calibration.save, (3, None)),
        ("path is of type", public.load_calibration, (3, None)),
        ("path is of type", read_windows, (3, None)),
        ("settings is of type", lambda x: read_windows(SAMPLE, x), (3,)),
        ("measured is of type", lambda x: public.identify(window, measured=x), ([1],)),
        ("telemetry is of type", monitor.feed, (window, 3)),
        ("count is of type", monitor.count, (3,)),
        ("stamp_ns is of type", lambda x: monitor.measure(x, {"load_torque": (0.1, 0.1)}), ("a",)),
        ("measured is of type", lambda x: monitor.measure(0, x), ([1],)),
        (
            "measurement is of type int, expected Measurement: Measurement.of",
            public.Tracker().update,
            (3,),
        ),
        ("duty is of type", public.Tracker().predict, (2.0,)),
        ("hours = 'a' h: expected a number", lambda x: public.track([estimate], [x]), ("a",)),
        ("duty = 'a': expected a number", public.FutureDuty, ("a",)),
        ("laws is of type", lambda x: public.TrackerSettings(laws=x), ("exponential", 3)),
        (
            "law of friction is of type str, expected KnownLaw",
            lambda x: public.TrackerSettings(laws={"friction": x}),
            ("exponential",),
        ),
        ("settings is of type", public.WindowFinder, (3,)),
        ("description is of type", lambda x: public.WindowFinder(trigger, x), (3,)),
        ("block is of type", public.WindowFinder(trigger).feed, (window,)),
        ("rig is of type", lambda x: public.certify(x, sine), (None, [window])),
        ("command is of type", lambda x: public.certify(print, x), (None, "sine")),
        ("rig is of type", lambda x: public.design_command(x, flap, limits), (None,)),
        ("description is of type", lambda x: public.design_command(print, x, limits), (None,)),
        ("limits is of type", lambda x: public.design_command(print, flap, x), (None, 3)),
        ("wanted is of type", lambda x: public.design_command(print, flap, limits, x), (3,)),
        ("command is of type", lambda x: ema_sim.simulate(command=x), ("chirp",)),
        ("description is of type", lambda x: ema_sim.simulate(description=x), (3,)),
        ("parameters is of type", lambda x: ema_sim.simulate(parameters=x), (3,)),
        ("resolutions is of type", lambda x: ema_sim.simulate(resolutions=x), (3,)),
        ("cycles = 'a': expected a whole number", lambda x: ema_sim.simulate(cycles=x), ("a",)),
        ("causes = 3: expected a list", lambda x: ema_sim.simulate(causes=x), (3,)),
        ("parameters is of type", lambda x: ema_sim.ActuatorDescription(parameters=x), (3,)),
        ("acquisition is of type", lambda x: ema_sim.ActuatorDescription(acquisition=x), (3,)),
        *(
            (f"{part.name} is of type", lambda x, of=of, name=part.name: of(**{name: x}), (3,))
            for of in (public.MonitorSettings, public.PrognosisSettings)
            for part in fields(of)
            if part.type not in (float, int, bool)
        ),
    ]
    for expected, call, values in calls:
        for wrong in values:
            with pytest.raises(ValueError, match=expected):
                call(wrong)
    with pytest.raises(ValueError, match="0 estimates and 1 hours: expected hours for each"):
        ema_monitor.track([], [1.0])
    with pytest.raises(ValueError, match="estimate is of type Window, expected Estimate"):
        ema_monitor.track([window], [1.0])


def test_paths_are_strings_or_paths(tmp_path):
    file = str(tmp_path / "calibration.yaml")
    calibration = ema_monitor.Calibration.builtin()
    calibration.save(file)
    loaded = (ema_monitor.load_calibration(file), ema_monitor.Calibration.load(file))
    assert {copy.calibration_id for copy in loaded} == {calibration.calibration_id}
    path = ema_monitor.Monitor(history_folder=str(tmp_path)).unit.history.path
    assert path is not None
    assert path.parent == tmp_path


def test_monitor_and_tracker_are_a_line_in_a_prompt(estimate):
    assert repr(ema_monitor.Monitor()) == "<Monitor: flap, 0 valid tests>"
    assert repr(ema_monitor.Tracker()) == "<Tracker: 0 tests>"
    assert repr(ema_monitor.track([estimate], [1.5])) == "<Tracker: 1 test, latest at 1.5 h>"


def test_results_are_a_line_in_a_prompt_and_a_text_in_a_notebook(window, estimate):
    calibration = ema_monitor.Calibration.builtin()
    outlook = outlook_of_one(estimate, ema_monitor.HealthLimits(), "no hours")
    prognosis = ema_monitor.track([estimate], [1.5]).predict()
    later = replace(
        outlook, flight_hours=1.5, rul=ema_monitor.RemainingLife(True, 1.0, 2.0, 3.5, "")
    )
    diagnosed = ema_monitor.Diagnosed(0, 0, ema_sim.ActuatorDescription(), estimate)
    refused = ema_monitor.identify(window, ema_sim.ActuatorDescription(serial_number="<b>"))
    words = {
        "Window: 0.5 s, 5000 samples at 10000 Hz": window,
        "Estimate: valid, friction 0.2": estimate,
        "Estimate: refused, the calibration does not fit": refused,
        f"Calibration: {calibration.calibration_id} of flap": calibration,
        "Outlook: level WARN, remaining life unknown>": outlook,
        "Outlook: level WARN, remaining life 1 / 2 / 3.5 h (5 / 50 / 95 %), 1.5 service": later,
        "Diagnosed: window 0, valid, friction 0.2": diagnosed,
        "Health: level WARN, health index 0.50, friction>": outlook.health,
        "Prognosis: remaining life unknown after 1.5 h>": prognosis,
    }
    for text, result in words.items():
        assert repr(result).startswith(f"<{text}")
        assert "\n" not in repr(result)
        assert len(repr(result)) < 400
        html = result._repr_html_()
        assert html.startswith("<pre>")
        assert "<b>" not in html


@pytest.mark.parametrize("package", [ema_sim, ema_monitor, ema_bags])
def test_interface_can_be_imported_as_a_whole_and_has_a_version(package):
    names: dict[str, object] = {}
    exec(f"from {package.__name__} import *", names)
    assert names.keys() >= set(dir(package))
    assert package.__version__ == ema_core.__version__


@pytest.mark.parametrize("package", [ema_sim, ema_monitor, ema_bags])
def test_dir_lists_the_documented_public_names(package):
    names = dir(package)
    assert names == sorted(names)
    for name in names:
        assert getattr(package, name).__doc__
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_importing_the_packages_imports_no_large_library():
    listed = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, ema_sim, ema_monitor, ema_bags\n"
            "print([name for name in ('numpy', 'numba', 'matplotlib') if name in sys.modules])",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ast.literal_eval(listed.stdout) == []


def test_text_table_has_figures_on_the_right():
    assert text_table(("name", "k"), [("a", "0.5"), ("bc", "10.0")]).splitlines() == [
        "name     k",
        "a      0.5",
        "bc    10.0",
    ]
