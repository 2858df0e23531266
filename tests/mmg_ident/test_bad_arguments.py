"""What makes no sense is one UserError from every function and constructor, never an error of another library."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mmg_ident as mi
from mmg.errors import refusing
from tests.support.calibrated import small_result
from tests.support.synthetic_runs import coarse_runs

SHIP = "esso_osaka_3m"
FRAME = pd.DataFrame({"t": [0.0, 1.0], "x": [0.0, 1.0]})
REST = {"psi": [0, 0], "u": [0, 0], "v": [0, 0], "r": [0, 0], "n": [0, 0]}
CALLS = """
mi.calibrate(123,train)
mi.calibrate(SHIP, [])
mi.calibrate(SHIP, None)
mi.calibrate(SHIP, [1,2])
mi.calibrate(SHIP, FRAME)
mi.calibrate(SHIP, train,settings=3)
mi.calibrate(SHIP, train,options={})
mi.calibrate(SHIP, train,windw=3)
mi.calibrate(SHIP, train,window="a")
mi.calibrate(SHIP, train,only=["Yv"])
mi.calibrate(SHIP, train,with_="curent")
mi.calibrate(SHIP, train,bootstrap="x")
mi.calibrate(SHIP, train,measurement="foo")
mi.calibrate(SHIP, train,captive="nope.csv")
mi.calibrate(SHIP, train,fix=3)
mi.calibrate(SHIP, train,with_={"current":3})
mi.calibrate(SHIP, train,estimator="foo")
mi.calibrate(SHIP, train,per_run="foo")
mi.score(SHIP, None)
mi.score(SHIP, held,sigma=[1,2])
mi.score(SHIP, held,sigma="a")
mi.score(SHIP, held,sigma=3.)
mi.score(SHIP, held,method=3)
mi.score(SHIP, held,adapt=-1)
mi.score(SHIP, held,windw=2)
mi.score(None,held)
mi.score(SHIP, held,sigma=[0]*6)
mi.score(SHIP, held,method="heun")
mi.score(SHIP, held,window=-1.0)
mi.predict(SHIP, held,window="a")
mi.predict(SHIP, held,stride=0)
mi.predict(SHIP, held,window=float("nan"))
mi.predict(SHIP, [])
mi.predict(fit,t.columns)
mi.simulate(SHIP, None)
mi.simulate(SHIP, "turn")
mi.simulate(SHIP, "turning:abc")
mi.simulate(SHIP, "turning:35",wind="fast")
mi.simulate(SHIP, "turning:35",wind=(3.0, 1.0))
mi.simulate(SHIP, "turning:35",wind=3.0)
mi.simulate(SHIP, np.arange(5.0),n=9.0,delta=0.0,wind=np.ones((5, 2)))
mi.simulate(SHIP, np.arange(5.0),n=9.0,delta=0.0,wind=lambda t: (3.0, 1.0))
mi.simulate(SHIP, "turning:35",effects="curent")
mi.simulate(SHIP, "turning:35",effects=3)
mi.simulate(SHIP, "turning:35",effects={"current":0.3})
mi.simulate(SHIP, "turning:35",effects={"current":{"x":np.nan}})
mi.simulate(SHIP, "turning:35",effects={"current":{"q":0.3}})
mi.simulate(SHIP, "turning:35",duration="long")
mi.simulate(SHIP, "turning:35",dt=-1)
mi.simulate(SHIP, "turning:35",n="a")
mi.simulate(SHIP, "turning:35",seed=-1,noise=True)
mi.simulate(SHIP, "turning:35",seed=1.5)
mi.simulate(SHIP, [0,1],n=[1,2,3],delta=0)
mi.simulate(SHIP, FRAME)
mi.simulate(SHIP, "turning:35",speed="x")
mi.simulate(SHIP, "turning:35",seed="x")
mi.simulate(SHIP, "turning:35",spede=1.0)
mi.simulate(SHIP, t,duration=3.0)
mi.simulate(SHIP, np.arange(5.0),n=1.0)
mi.simulate(SHIP, np.arange(5.0),n=1.0,delta=0.0,dleta=0.0)
mi.simulate(SHIP, np.arange(5.0),n=np.nan,delta=0.0)
mi.simulate(SHIP, np.arange(5.0),n="fast",delta=0.0)
mi.simulate(SHIP, np.arange(5.0),n=1.0,delta=0.0,x0=np.zeros(5))
mi.simulate(SHIP, np.arange(5.0),n=1.0,delta=0.0,wind_speed=3.0)
mi.simulate(SHIP, np.arange(5.0)[::-1],n=1.0,delta=0.0)
mi.simulate(SHIP, np.arange(5.0).reshape(1, 5),n=1.0,delta=0.0)
mi.simulate(SHIP, np.arange(5.0),n=1.0,delta=0.0,duration=5.0)
mi.simulate_many([SHIP],None)
mi.simulate_many({"N_r":[-0.05]},"turning:35",ship=SHIP)
mi.simulate_many(np.ones((2, 3)),"turning:35",ship=SHIP)
mi.simulate_many(pd.DataFrame({"foo":[1.]}),"turning:35",ship=SHIP)
mi.simulate_many(pd.DataFrame({"N_r":["a"]}),"turning:35",ship=SHIP)
mi.simulate_many(pd.DataFrame({"N_r":[-0.05]}),"turning:35")
mi.imo(None)
mi.imo(SHIP, scatter=3)
mi.imo(SHIP, scatter="x")
mi.imo(SHIP, sped=1.0)
mi.imo(SHIP, [t],scatter=50)
mi.imo(SHIP, [t],current=3)
mi.imo(SHIP, rudder_rate="x")
mi.imo(SHIP, [t],length=-3)
mi.plan(fit,"60",100.)
mi.plan(fit,(60, 25),100.)
mi.plan(fit,"60x25","x")
mi.plan(SHIP, "60x25",100.)
mi.plan(fit,"60x25",100.,coefficients="foo")
mi.plan(fit,"60x25",100.,start=(1,2))
mi.plan(fit,"60x25",100.,figurs=1)
mi.train(SHIP, train,seeds="3")
mi.train(SHIP, train,keep="foo")
mi.train(SHIP, train,model="foo")
mi.train(SHIP, train,loss="foo")
mi.train(SHIP, train,epoch=3)
mi.train(SHIP, [])
mi.train(SHIP, train,settings=3)
mi.train(SHIP, train,settings=mi.TrainSettings(),model="fnn")
mi.train(SHIP, train,curriculum=[])
mi.train(SHIP, train,settings=mi.TrainSettings(curriculum=((10, 0),)))
mi.diagnose(SHIP, [])
mi.diagnose(SHIP, train,step="x")
mi.diagnose(SHIP, train,stp=0.1)
mi.diagnose(SHIP, train,between="foo")
mi.diagnose(SHIP, train,without="foo")
mi.diagnose(SHIP, train,options=3)
mi.diagnose(SHIP, train,site="nope.toml")
mi.gap(SHIP, train,[])
mi.gap(SHIP, train,train,seeds="x")
mi.gap(SHIP, train,train,seed_s=1)
mi.gap(3,train,train)
mi.gap(SHIP, train,held,workers="x")
mi.select(SHIP, train,only="foo")
mi.select(SHIP, train,objective="foo")
mi.select(SHIP, [])
mi.select(SHIP, train,order="x")
mi.import_logs("nope.csv","out")
mi.import_logs(3,"out")
mi.months("nope", SHIP)
mi.fleet("nope.toml")
mi.view("nope","out.html")
mi.view(3,"out.html")
mi.report("nope","out.html")
mi.report(3,"out.html")
mi.export("nope","c","out")
mi.export(SHIP, "foo","out")
mi.export(3,"c","out")
mi.scale(SHIP, "x")
mi.scale(SHIP, -3)
mi.scale(3,100.)
mi.load_run("nope")
mi.load_run(3)
mi.load_ship("nope")
mi.load_ship(3)
mi.new_ship("x",{"L":3})
mi.new_ship("x",{"L":"a","B":1,"d":1,"C_b":.6})
mi.read_trials("nope")
mi.read_trials(3)
mi.check(3)
mi.check(FRAME)
mi.refit(SHIP)
mi.refit(fit, {"N_r":"a"})
mi.refit(fit, ["N_r"])
fit.save(3)
fit.sample("a")
fit.sample(3.5)
fit.sample(3,seed=-1)
fit.sample(3,method="nutz")
mi.gap(SHIP, train, test=held, options=mi.GapOptions(), seeds=2)
mi.Trial.from_pandas(FRAME)
mi.Trial.from_pandas(3)
mi.Trial.from_pandas(t.to_pandas(),units=["deg"])
mi.Trial.from_pandas(t.to_pandas(),units=3)
mi.Trial.from_pandas(t.to_pandas().assign(**{"u [m/s]": 1j}))
mi.calibrate(SHIP, t.to_pandas())
mi.check({"t": [0.0, 1.0]})
mi.Trial.from_pandas(pd.DataFrame())
mi.Trial.from_arrays(t=[0,1],u=["a","b"])
mi.Trial.from_arrays(t=3)
mi.Trial.from_arrays(t=[1, 0], **REST, delta=[0, 0])
mi.Trial.from_arrays(t=[0, 1], **REST, delat=[0, 0])
t[10:5]
t.resample("x")
t.resample(1e-12)
t.resample(0)
t["foo"]
t+3
t.between("a",3)
mi.Trial("a",{})
mi.Trial("a",None)
mi.Trial("a",{"t":[0,1],"u":[[1],[1,2]]})
mi.Trial("a",{"t":"x"})
mi.Trial("a",{"t":np.array(["a","b"])})
mi.Trial("a",{"t":np.array([0,np.nan])})
mi.load_ship(SHIP).with_values(N_x=3)
mi.load_ship(SHIP).with_values(N_r="a")
mi.load_ship(SHIP).with_values(N_r=float("nan"))
mi.load_ship(SHIP).with_values(N_r=None)
mi.load_ship(SHIP).with_values(N_r=[1])
mi.load_ship(SHIP).with_values(N_r=1j)
mi.load_ship(SHIP).with_values(N_r=np.array([1.0, 2.0]))
mi.load_ship(SHIP).with_values("N_r")
mi.load_ship(SHIP).with_effect("current",x=np.nan)
mi.load_ship(SHIP).with_effect("current",x="a")
mi.load_ship(SHIP).with_effect(["current"])
mi.load_ship(SHIP).with_effect("curent")
mi.load_ship(SHIP).with_effect("current",z=1)
mi.load_ship(SHIP).without("sail")
mi.load_ship(SHIP).without(["wind"])
mi.load_ship(SHIP).rhs([0]*5,{"n":1,"delta":0})
mi.load_ship(SHIP).rhs(["a"]*6,{"n":1,"delta":0})
mi.load_ship(SHIP).rhs([0]*6,{"n":"a","delta":0})
mi.load_ship(SHIP).rhs([0]*6,[1,2])
mi.load_ship(SHIP).fixing(["foo"])
fit.plot.tracks(trial=99)
fit.plot.tracks(trial="nowhere")
fit.plot.residuals(channel="w")
fit.plot.forces(trial=t, component="Z")
mi.calibrate(SHIP, train,settings=mi.Settings(window=-3))
mi.TrainSettings(seeds=-1) and mi.train(SHIP, train,settings=mi.TrainSettings(seeds=-1))
"""
"""One a line, as a person would type it."""


@pytest.mark.parametrize("call", CALLS.strip().splitlines())
def test_what_makes_no_sense_is_a_user_error(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    train, held = coarse_runs()
    names = {"mi": mi, "np": np, "pd": pd, "SHIP": SHIP, "FRAME": FRAME, "REST": REST, "train": train, "held": held}
    with pytest.raises(mi.UserError) as found:
        eval(call, {**names, "t": train[0], "fit": small_result()})
    assert "\n" not in str(found.value) and not any(tmp_path.iterdir())


OTHERS = """
Settings FitOptions TrainSettings BlackBoxSettings GapOptions DiagnosisOptions Trial TrialSet Tracker Coefficient
Parameter Ship scale load_ship new_ship read_trials force effect check calibrate score predict train diagnose gap select
refit plan fleet months view load_run report imo compare card
"""


@pytest.mark.parametrize("call", OTHERS.split())
def test_a_keyword_that_is_none_is_a_user_error_with_the_nearest(call: str) -> None:
    with pytest.raises(mi.UserError) as found:
        getattr(mi, call)(nonsense_=3)
    assert found.value.code == "unknown_name" and "nonsense_" in str(found.value)


def test_so_it_is_of_methods() -> None:
    fit, (trial, *_) = small_result(), coarse_runs()[0]
    for method in (fit.sample, fit.plot.tracks, trial.resample, trial.plot, trial.between, fit.ship.fixing, fit.save):
        with pytest.raises(mi.UserError) as found:
            method(nonsense_=3)  # type: ignore[operator]
        assert found.value.code == "unknown_name"


def test_an_error_within_a_function_is_its_own() -> None:
    @refusing
    def broken(n: int) -> int:
        return n + "a"  # type: ignore[operator]

    with pytest.raises(TypeError):
        broken(n=3)


def test_results_can_be_compared() -> None:
    fit = small_result()
    assert fit == copy.deepcopy(fit)


def test_columns_may_be_lists() -> None:
    train, _ = coarse_runs()
    listed = mi.Trial("a", {name: values.tolist() for name, values in train[0].columns.items()})
    assert np.array_equal(listed.states, train[0].states)


def test_a_report_of_a_check_is_shown_on_a_screen() -> None:
    train, _ = coarse_runs()
    (report,) = mi.check(train[0].with_columns(delta=-train[0]["delta"]))
    lines = repr(dataclasses.replace(report, findings=report.findings * 20)).splitlines()
    assert len(lines) <= 15 and max(map(len, lines)) <= 120


def test_effects_by_name_are_those_in_words() -> None:
    times, inputs = np.arange(0.0, 5.0, 0.5), {"n": 9.0, "delta": 0.1}
    words = mi.simulate(SHIP, times, effects="current:x=0.3", **inputs)
    by_name = mi.simulate(SHIP, times, effects={"current": {"x": np.float64(0.3)}}, **inputs)
    assert np.array_equal(words.states, by_name.states)
    assert not np.allclose(words.states, mi.simulate(SHIP, times, **inputs).states)


def test_names_with_commas_between_them_are_several_as_in_the_commands() -> None:
    train, _ = coarse_runs()
    with pytest.raises(mi.UserError) as found:
        mi.calibrate(SHIP, train, only="N_r,N_rr,nowhere")
    assert "nowhere" in str(found.value) and "N_r,N_rr" not in str(found.value)


def test_test_trials_that_are_training_trials_are_named() -> None:
    train, _ = coarse_runs()
    with pytest.raises(mi.UserError) as found:
        mi.gap(small_result(), train, test=train[:1])
    assert train[0].name in str(found.value)
