"""What is delivered knows where it comes from, what it held, and what to be careful about."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cases.shipfiles.ship_file import dump_ship, dump_whole_ship, load_ship
from delivery.export import ABOUT, FORMATS, export
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.variables import variable_table
from delivery.fmi.write import description
from delivery.product import (
    LEFT_OUT,
    NAME_CHANGED,
    NO_RANGE,
    NOT_CONVERGED,
    UNCALIBRATED,
    UNEXCITED,
    identifiers,
    product_of,
)
from mmg.errors import BadValue, NotCalibrated, Unsupported
from mmg.messages import has_code
from tests.support.calibrated import small_result
from tests.support.commands import refusal, shown
from tests.support.fmus import network

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("product") / "run"
    small_result().save(path)
    return path


def changed(run: Path, folder: Path, content: dict[str, Any]) -> Path:
    """The ``run`` in a new ``folder`` with this ``content`` of its result.json."""
    folder.mkdir(parents=True)
    shutil.copyfile(run / "ship.toml", folder / "ship.toml")
    (folder / "result.json").write_text(json.dumps(content))
    return folder


def test_coefficients_that_no_trial_excites_are_a_caveat(run: Path, tmp_path: Path) -> None:
    content = json.loads((run / "result.json").read_text())
    rows = content["identifiability"]["coefficients"]
    first, second, *_ = rows
    for symbol in (first, second):
        rows[symbol]["kind"] = "silent"
    (caveat,) = product_of(changed(run, tmp_path / "unexcited", content)).caveats
    assert caveat.code == UNEXCITED and f"2 of {len(rows)} " in str(caveat) and f"{first}, {second}" in str(caveat)


def test_a_calibrated_ship_brings_its_record_with_hashes_of_run_and_data(run: Path) -> None:
    found, ship = product_of(run), (run / "ship.toml").read_bytes()
    assert not found.caveats and found.identifier == "esso_osaka_3m"
    text = (run / "result.json").read_bytes()
    content, record = json.loads(text), hashlib.sha256(text).hexdigest()
    assert found.ranges == product_of(run / "ship.toml").ranges == {k: tuple(v) for k, v in content["envelope"].items()}
    from_run = {key: found.provenance[key] for key in ("result_sha256", "ship_sha256", "source", "created")}
    hashes = {"result_sha256": record, "ship_sha256": hashlib.sha256(ship).hexdigest(), "source": f"run {record[:12]}"}
    assert from_run == {**hashes, "created": content["created"]}
    assert [row["sha256"] for row in found.provenance["data"]] == [row["sha256"] for row in content["data"]]
    assert found.provenance["command"].split() == ["mmg", "fit", "ship", "a.csv", "--out", "run"]
    assert f"run {record[:12]}" in " ".join(found.sentences) and "(data " in " ".join(found.sentences)
    by_symbol, fitted = {c.symbol: c for c in found.coefficients}, content["coefficients"]["Y_v"]
    assert by_symbol["Y_v"].std == fitted["std"] and by_symbol["Y_v"].verdict == fitted["verdict"]
    assert by_symbol["N_v"].std is None, "a fixed coefficient has no standard error"


def contents(target: Path) -> dict[str, bytes]:
    """The files of a product by name, those in an FMU by their names in it and the whole beside them."""
    files = [target] if target.is_file() else sorted(p for p in target.rglob("*") if p.is_file())
    found = {p.name: p.read_bytes() for p in files}
    if target.suffix == ".fmu":
        with zipfile.ZipFile(target) as archive:
            found |= {name: archive.read(name) for name in archive.namelist()}
    return found


@pytest.mark.slow
@pytest.mark.parametrize("form", sorted(FORMATS))
def test_a_run_gives_the_same_bytes_wherever_it_lies(form: str, run: Path, tmp_path: Path) -> None:
    """A product holds the title of its calibration, hashes of its run and of the data, and no path of either."""
    first, other = tmp_path / "a" / "run", tmp_path / "a longer name" / "copy"
    shutil.copytree(run, first)
    record = json.loads((run / "result.json").read_text())
    record["command"] = f"mmg fit '{tmp_path}/my ship.toml' {tmp_path}/a.csv --with current --out {first}/"
    record["data"][0]["path"] = f"{tmp_path}/a.csv"
    (first / "result.json").write_text(json.dumps(record))
    if form == "onnx":
        pytest.importorskip("onnx")
        ship = load_ship(run)
        (first / "ship.toml").write_text(dump_whole_ship(ship.with_network(network(ship, 4)), "A ship."))
    shutil.copytree(first, other)
    options = {"platforms": ["none"]} if form.startswith("fmu") else {}
    found = []
    for folder in (first, other):
        target = folder.parent / f"product{FORMATS[form].suffix}"
        export(product_of(folder), form, target, **options)
        found.append(contents(target))
    assert found[0] == found[1] and found[0]
    assert any(load_ship(first).title.encode() in content for content in found[0].values())
    assert not any(str(tmp_path).encode() in content for content in found[0].values())


def test_a_ship_that_was_never_calibrated_leaves_by_force_only(tmp_path: Path) -> None:
    said = refusal("export", "esso_osaka_3m", "--format", "c", "--out", tmp_path / "c", "--json")
    assert said.endswith("[not_calibrated]") and "--force" in said and not (tmp_path / "c").exists()
    printed = shown("export", "esso_osaka_3m", "--format", "c", "--out", tmp_path / "c", "--force")
    assert [c["code"] for c in printed["caveats"]] == [UNCALIBRATED, NO_RANGE]
    assert printed["caveats"][0]["text"] in (tmp_path / "c" / "esso_osaka_3m.c").read_text()
    assert json.loads((tmp_path / "c" / ABOUT).read_text())["caveats"] == printed["caveats"]


def test_a_run_that_did_not_converge_leaves_by_force_only(run: Path, tmp_path: Path) -> None:
    content = json.loads((run / "result.json").read_text()) | {"converged": False, "status": "Maximum_Iterations"}
    stopped = changed(run, tmp_path / "stopped", content)
    with pytest.raises(NotCalibrated, match=r"Maximum_Iterations.*--force"):
        product_of(stopped)
    assert has_code(product_of(stopped, force=True).caveats, NOT_CONVERGED)


def test_targets_are_not_lost(run: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.txt").write_text("mine")
    words = ("export", run, "--format", "c", "--out")
    assert refusal(*words, mine, "--json").endswith("[target_exists]")
    for target in (mine, mine / "thesis.txt"):
        assert refusal(*words, target, "--force", "--json").endswith("[target_exists]")
    assert (mine / "thesis.txt").read_text() == "mine"
    assert refusal(*words, mine / "thesis.txt" / "c", "--json").endswith("[not_writable]")
    shown(*words, tmp_path / "c")
    (tmp_path / "c" / "esso_osaka_3m.c").write_text("")
    shown(*words, tmp_path / "c", "--force")
    assert (tmp_path / "c" / "esso_osaka_3m.c").read_text() != ""
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c", "mine"]


def test_unknown_words_are_refused(run: Path, tmp_path: Path) -> None:
    others = (run, "fortran"), (run, "c", "--without", "tow"), (tmp_path / "nothing", "c")
    for where, form, *more in others:
        said = refusal("export", where, "--format", form, *more, "--out", tmp_path / "c", "--json")
        assert said.endswith("[unknown_name]")


def test_an_exact_delay_is_refused_with_what_to_do(tmp_path: Path) -> None:
    ship = load_ship("esso_osaka_3m").with_effect("control_delay", {"tau": 0.4})
    (tmp_path / "late.toml").write_text(dump_ship(ship))
    with pytest.raises(Unsupported, match="--without control_delay"):
        export(product_of(tmp_path / "late.toml", force=True), "c", tmp_path / "c")
    assert not (tmp_path / "c").exists()
    left = product_of(tmp_path / "late.toml", force=True, without=["control_delay"])
    assert has_code(left.caveats, LEFT_OUT) and "control_delay" not in left.ship.effects
    export(left, "c", tmp_path / "c")


def test_an_effect_goes_with_its_values_by_campaign(tmp_path: Path) -> None:
    ship = load_ship("esso_osaka_3m").with_effect("gyro").with_effect("log_scale")
    ship = replace(ship, campaigns={"spring": {"gyro.T": 0.9, "log_scale.share": 0.02}, "autumn": {"gyro.T": 0.4}})
    (tmp_path / "ship.toml").write_text(dump_ship(ship))
    export(product_of(tmp_path / "ship.toml", force=True, without=["gyro"]), "toml", tmp_path / "left.toml")
    assert load_ship(tmp_path / "left.toml").campaigns == {"spring": {"log_scale.share": 0.02}}


def test_a_product_is_called_as_its_calibration(run: Path) -> None:
    found = product_of(run)
    mark = found.ship.mark
    assert mark is not None and mark.name != found.ship.name and found.about()["ship"] == mark.name
    ship = CoSimulatedShip.of(found)
    assert f'modelName="{mark.name}"' in description(ship, variable_table(ship), 2, "", ())


def test_identifiers_are_distinct_and_no_reserved_words(tmp_path: Path) -> None:
    made = identifiers(["a.b", "a_b", "a b", "double", "日本", "9", "A_B"])
    assert len({name.lower() for name in made}) == len(made) and "double" not in made
    assert all(name.isidentifier() and name.isascii() for name in made)
    (tmp_path / "ship.toml").write_text(dump_ship(replace(load_ship("esso_osaka_3m"), name="2nd Été")))
    found = product_of(tmp_path / "ship.toml", force=True)
    assert found.identifier == "ship_2nd_ete" and has_code(found.caveats, NAME_CHANGED)


def test_a_command_takes_what_was_exported(tmp_path: Path) -> None:
    path, maneuver = tmp_path / "ship.toml", ("--maneuver", "turning:35", "--duration", "20")
    shown("export", "esso_osaka_3m", "--format", "toml", "--out", path, "--force")
    assert shown("simulate", path, *maneuver) == shown("simulate", "esso_osaka_3m", *maneuver)


def test_a_file_of_another_ending_and_what_is_no_path_are_refused(tmp_path: Path) -> None:
    for out in (tmp_path / "ship.json", 3):
        with pytest.raises(BadValue):
            export(product_of("esso_osaka_3m", force=True), "toml", out)  # type: ignore[arg-type]
