"""What makes no sense is one UserError from every function and constructor, never an error of another library."""

from __future__ import annotations

import copy
import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

import mmg_ident as mi
from mmg.errors import refusing
from tests.support.calibrated import small_result
from tests.support.synthetic_runs import coarse_runs

SHIP = "esso_osaka_3m"
FRAME = pd.DataFrame({"t": [0.0, 1.0], "x": [0.0, 1.0]})
SIZES = {"L": 3.0, "B": 0.49, "d": 0.2, "C_b": 0.8}
REST = {"psi": [0, 0], "u": [0, 0], "v": [0, 0], "r": [0, 0], "n": [0, 0]}
CALLS = """
mi.calibrate( 123,train SHIP,[] SHIP,None SHIP,[1,2] SHIP,FRAME SHIP,t.to_pandas()
mi.calibrate(SHIP,train, settings=3 settings=mi.Settings(window=-3) options={} windw=3 window="a" with_="curent"
mi.calibrate(SHIP,train, bootstrap="x" measurement="foo" captive="nope.csv" fix=3 with_={"current":3} per_run="foo"
mi.calibrate(SHIP,train, name="a/b" captive=3 bootstrap=np.nan interval=10**6 captive_sigma="a"
mi.score( SHIP,None None,held
mi.score(SHIP,held, sigma=[1,2] sigma="a" sigma=3. sigma=[0]*6 method=3 method="heun" adapt=-1 windw=2 window=-1.0
mi.predict( SHIP,held,window="a" SHIP,held,stride=0 SHIP,[] fit,t.columns
mi.simulate( SHIP,None SHIP,"turn" SHIP,"turning:abc" SHIP,FRAME SHIP,[0,1],n=[1,2,3],delta=0 SHIP,t,duration=3.0
mi.simulate(SHIP,"turning:35", wind="fast" wind=(3.0,1.0) wind=3.0 effects=3 effects={"current":0.3} speed="x" n="a"
mi.simulate(SHIP,"turning:35", effects={"current":{"x":np.nan}} effects={"current":{"q":0.3}} duration="long" spede=1.0
mi.simulate(SHIP,"turning:35", seed="x" seed=1.5 seed=-1,noise=True
mi.simulate(SHIP,np.arange(5.0), n=1.0 n=1.0,delta=0.0,dleta=0.0 n=np.nan,delta=0.0 n="fast",delta=0.0
mi.simulate(SHIP,np.arange(5.0),n=1.0,delta=0.0, x0=np.zeros(5) wind_speed=3.0 duration=5.0 wind=np.ones((5,2))
mi.simulate(SHIP,np.arange(5.0),n=1.0,delta=0.0, wind=lambda\u00a0t:(3.0,1.0)
mi.simulate(SHIP, np.arange(5.0)[::-1],n=1.0,delta=0.0 np.arange(5.0).reshape(1,5),n=1.0,delta=0.0
mi.simulate_many( [SHIP],None {"N_r":[-0.05]},"turning:35",ship=SHIP np.ones((2,3)),"turning:35",ship=SHIP
mi.simulate_many(pd.DataFrame( {"foo":[1.]}),"turning:35",ship=SHIP {"N_r":["a"]}),"turning:35",ship=SHIP
mi.simulate_many(pd.DataFrame( {"N_r":[-0.05]}),"turning:35"
mi.imo(SHIP, trials=None scale=-1.0 scale=np.nan
mi.imo( None SHIP,scatter="x" SHIP,scatter=3 SHIP,[t],length=-3 SHIP,sped=1.0 SHIP,[t],scatter=50
mi.imo(SHIP, [t],current=3 rudder_rate="x"
mi.plan( fit,"60",100. fit,(60,25),100. fit,"60x25","x" SHIP,"60x25",100.
mi.train( 3,train None,train
mi.train(SHIP,train, seeds="3" loss="foo" epoch=3 settings=3 settings=mi.TrainSettings(),model="fnn" curriculum=[]
mi.train(SHIP,train, settings=mi.TrainSettings(curriculum=((10,0),)) settings=mi.TrainSettings(seeds=-1)
mi.diagnose( SHIP,[] SHIP,train,site="nope.toml" SHIP,train,step="x" SHIP,train,stp=0.1 SHIP,train,options=3
mi.gap(SHIP,train,held, workers=-1 seed=np.nan
mi.gap( SHIP,train,[] 3,train,train SHIP,train,held,seeds="x" SHIP,train,held,options=mi.GapOptions(),seeds=2
mi.select(SHIP, train,seeds="x" train,only="foo" train,objective="foo" [] train,order="x"
mi.compare(train,held,SHIP,"captive", seeds=-1 epochs=np.nan workers=0 step="a"
mi.compare( FRAME,held
mi.import_logs( "nope.csv","out" 3,"out"
mi.months( "nope",SHIP
mi.fleet( "nope.toml"
mi.view( "nope","out.html" 3,"out.html"
mi.report( "nope","out.html" 3,"out.html" [],"out.html" [3],"out.html"
mi.export( SHIP,["c"],"out" SHIP,"c","out",without=None "nope","c","out" SHIP,"foo","out" 3,"c","out"
mi.scale( SHIP,"x" SHIP,-3 3,100.
mi.load_run( "nope" 3
mi.load_ship( "nope" 3
mi.new_ship("x", {"L":3} {"L":"a","B":1,"d":1,"C_b":.6}
mi.read_trials( "nope" 3
mi.check( 3 FRAME {"t":[0.0,1.0]}
mi.refit( SHIP fit,{"N_r":"a"} fit,["N_r"]
fit.save( 3
fit.sample( "a" 3.5 3,seed=-1 3,method="nutz"
fit.plot. tracks(trial=99 tracks(trial="nowhere" residuals(channel="w" forces(trial=t,component="Z"
mi.Trial.from_pandas( FRAME 3 pd.DataFrame() t.to_pandas().assign(**{"u\u00a0[m/s]":1j}) t.to_pandas(),units=["deg"]
mi.Trial.from_arrays( t=[0,1],u=["a","b"] t=3 t=[1,0],**REST,delta=[0,0] t=[0,1],**REST,delat=[0,0]
mi.Trial("a", {} None {"t":[0,1],"u":[[1],[1,2]]} {"t":"x"} {"t":np.array(["a","b"])} {"t":np.array([0,np.nan])}
t.__getitem__( slice(10,5) "foo"
t.__add__( 3
t.between( "a",3
t.resample( "x" 1e-12 0
mi.load_ship(SHIP).with_values( N_x=3 N_r="a" N_r=float("nan") N_r=None N_r=[1] N_r=1j N_r=np.array([1.0,2.0]) "N_r"
mi.load_ship(SHIP).with_effect( "current",x=np.nan "current",x="a" ["current"] "curent" "current",z=1
mi.load_ship(SHIP).without( "sail" ["wind"]
mi.load_ship(SHIP).rhs( [0]*5,{"n":1,"delta":0} ["a"]*6,{"n":1,"delta":0} [0]*6,{"n":"a","delta":0} [0]*6,[1,2]
mi.load_ship(SHIP).fixing( ["foo"] None
mi.load_ship( "a"*5000
mi.load_ship(SHIP).rhs( [1j]*6,{"n":1,"delta":0}
mi.new_ship( 3,SIZES "x",None "x",[1] "x",{**SIZES,"Dp":.1} "x",{**SIZES,"D_P":None} "x",SIZES,hull=np.zeros(3)
mi.Ship("x",{},{},{}, notices=3 effects="current" network="net"
mi.Trial("a",{"t":[0,1]}, path="a.csv" meta=3
mi.Trial.from_arrays(t=[0,1], u=[[1],[1,2]] u=TENSOR
mi.TrialSet( None
mi.simulate(SHIP,"turning:35", noise=[1,2] sampled_helm="no"
mi.simulate_many(pd.DataFrame( np.zeros((2,3))),"turning:35",ship=SHIP
mi.predict(SHIP,held, progress=3 unchecked="no"
mi.Tracker(fit,compiled=False, noise="x" coefficients=None campaign=["a"]
following. update(1e300,{},[9,0] forecast(1e300 update(1,{},[1j]*2 update(1,{},[9,0]).__getitem__("w"
fit.sample( 10**9
fit.problem.objective( "a" {"N_r":"a"}
fit.plot.tracks( ax=3 trial=[1]
t.plot( 3
t.__getitem__( ["u","v"]
t.unwrapped( "foo"
"""
"""A row: how a call begins, and each of the ways in which it goes on that make no sense, without blanks."""


def calls(table: str) -> list[str]:
    """The calls of a ``table``."""
    rows = [line.split(" ") for line in table.strip().splitlines()]
    return [f"{begin}{rest})".replace("\u00a0", " ") for begin, *rests in rows for rest in rests]


def following() -> mi.Tracker:
    """A tracker that has seen a sample."""
    tracker = mi.Tracker(small_result(), compiled=False)
    tracker.update(0.0, {"psi": 0.0, "u": 0.5}, {"n": 9.0, "delta": 0.0})
    return tracker


@pytest.mark.parametrize("call", calls(CALLS))
def test_what_makes_no_sense_is_a_user_error(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    train, held = coarse_runs()
    names = {"mi": mi, "np": np, "pd": pd, "SHIP": SHIP, "FRAME": FRAME, "REST": REST, "train": train, "held": held}
    with pytest.raises(mi.UserError) as found:
        names |= {"TENSOR": torch.ones(2, requires_grad=True), "SIZES": SIZES, "following": following()}
        eval(call, {**names, "t": train[0], "fit": small_result()})
    assert "\n" not in str(found.value) and not any(tmp_path.iterdir())


OTHERS = """
mi. Settings FitOptions TrainSettings BlackBoxSettings GapOptions DiagnosisOptions Trial TrialSet Tracker Coefficient
mi. Parameter Ship scale load_ship new_ship read_trials force effect check calibrate score predict train diagnose gap
mi. select refit plan fleet months view load_run report imo compare card
fit. sample plot.tracks save ship.fixing
t. resample plot between
"""


@pytest.mark.parametrize("call", [call.replace(")", "(nonsense_=3)") for call in calls(OTHERS)])
def test_a_keyword_that_is_none_is_a_user_error_with_the_nearest(call: str) -> None:
    with pytest.raises(mi.UserError) as found:
        eval(call, {"mi": mi, "fit": small_result(), "t": coarse_runs()[0][0]})
    assert found.value.code == "unknown_name" and "nonsense_" in str(found.value)


def test_an_error_within_a_function_is_its_own() -> None:
    @refusing
    def broken(n: int) -> int:
        return n + "a"  # type: ignore[operator]

    with pytest.raises(TypeError):
        broken(n=3)


RESULTS = """
fitting.design.planned_trial:PlannedTrial fitting.selection.structure_choice:StructureChoice
residual.papers.comparison:Comparison diagnosis.groups.months:MonthStudy mmg_ident.fleets.rows:Fleet
fitting.prediction.figure_intervals:JudgedFigures fitting.report.ship_card:ShipCard mmg_ident:FitResult
mmg_ident:TrainResult mmg_ident:Diagnosis mmg_ident:Gap mmg_ident:Score mmg_ident:Prediction mmg_ident:Ship
mmg_ident:CheckReport mmg_ident:Posterior mmg_ident:Trial mmg_ident:TrialSet
"""


@pytest.mark.parametrize("result", RESULTS.split())
def test_results_are_shown_in_words_of_their_own(result: str) -> None:
    module, name = result.split(":")
    shown = getattr(importlib.import_module(module), name).__repr__
    assert not hasattr(shown, "__wrapped__") and shown is not object.__repr__  # that of a dataclass shows all it holds


def test_coefficients_are_counted_by_their_verdict_alone() -> None:
    words = ["shared with a: the data", "shared with b and others", "prior (100 %)", "-1.5 of it; there: prior"]
    fit = small_result()
    rows = zip(fit.estimates.items(), words, strict=False)
    made = dataclasses.replace(fit, estimates={s: dataclasses.replace(row, verdict=w) for (s, row), w in rows})
    assert "coefficients: 2 shared, 2 prior" in repr(made)


def test_masked_numbers_are_missing_and_not_what_lies_under_the_mask() -> None:
    train, _ = coarse_runs()
    u = np.ma.masked_array(train[0]["u"].copy(), mask=train[0].t == 1.0)
    u.data[2] = 1e20
    columns = {**train[0].columns, "u": u}
    for trial in (mi.Trial("a", columns), mi.Trial.from_arrays(**columns)):
        assert np.isnan(trial["u"][2]) and np.isfinite(trial["u"]).sum() == len(trial) - 1
    with pytest.raises(mi.UserError):
        mi.simulate(SHIP, [0.0, 1.0], n=np.ma.masked_array([9.0, 1e20], mask=[0, 1]), delta=0.0)


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
