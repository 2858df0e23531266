"""What lies in and beside an FMU: descriptions that hold the schemas, sources, libraries; the same bytes each time."""

from __future__ import annotations

import math
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from delivery.export import export
from delivery.fmi.binaries import PLATFORMS, build_here, platforms_of, this_platform
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.variables import variable_table
from delivery.fmi.write import LATE_COLUMNS, OSP_DESCRIPTION, SOURCES_ONLY, osp_groups, write_fmu
from delivery.product import NOT_CONVERGED, Product, exponents, plain_unit
from mmg.compile.cache import compiler
from mmg.errors import Conflict, NotInstalled, TargetExists, UnknownName
from mmg.messages import Message, has_code
from mmg.motion.flow import STATES
from mmg_ident.commands.main import main
from tests.docs.pages import ROOT, blocks
from tests.support.c_products import STRICT, library_product, product
from tests.support.commands import refusal
from tests.support.fmus import fmu, needs_compiler, running, ship_of


def members(path: Path) -> dict[str, bytes]:
    """The files in an FMU by name."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def source_fmu(of: Product, version: int, folder: Path) -> Path:
    """An FMU without library."""
    write_fmu(of, folder / "ship.fmu", version, ["none"])
    return folder / "ship.fmu"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "version"), [("esso_osaka_3m", 2), ("vectwin_3m", 3), ("kvlcc2_full", 3), ("mariner", 2)]
)
def test_descriptions_hold_the_schemas_of_the_standard(name: str, version: int, tmp_path: Path) -> None:
    fmpy, validation = pytest.importorskip("fmpy"), pytest.importorskip("fmpy.validation")
    from lxml import etree

    path = source_fmu(library_product(name), version, tmp_path)
    assert validation.validate_fmu(str(path)) == []
    if version == 3:
        schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3BuildDescription.xsd"
        document = etree.fromstring(members(path)["sources/buildDescription.xml"])
        etree.XMLSchema(etree.parse(str(schema))).assertValid(document)


def test_inputs_are_named_by_role_and_symbol() -> None:
    table = variable_table(CoSimulatedShip.of(library_product("vectwin_3m")))
    names = [row.name for row in table.of("input")]
    assert {"propeller.n", "rudder.delta_port", "rudder.delta_starboard"} <= set(names)
    assert names[-4:] == [f"{what}_velocity.{axis}" for what in ("wind", "current") for axis in ("north", "east")]


@pytest.mark.slow
def test_units_have_those_that_people_read() -> None:
    of = product("esso_osaka_3m")
    rows = {row.name: row for row in variable_table(CoSimulatedShip.of(of)).rows}
    assert rows["propeller.n"].unit == "1/s" and rows["rudder.delta"].unit == "rad"
    root = Xml.fromstring(members(fmu("plain", 2))["modelDescription.xml"]) if shutil.which("gcc") else None
    if root is not None:
        shown = {unit.get("name"): unit.find("DisplayUnit") for unit in root.iter("Unit")}
        factors = {name: float(shown[name].get("factor")) for name in ("rad", "m/s", "1/s")}  # type: ignore[union-attr, arg-type]
        assert factors == pytest.approx({"rad": math.degrees(1), "m/s": 3600 / 1852, "1/s": 60.0})
    assert plain_unit("kg/m³") == "kg/m3" and exponents("kg/m3") == {"kg": 1, "m": -3}
    assert exponents("N.m") == {"kg": 1, "m": 2, "s": -2} and exponents("furlong") is None


def test_coefficients_say_how_well_they_are_known() -> None:
    ship = ship_of("plain")
    known = ship.coefficients["Y_v"].with_(std=0.0123, verdict="well determined", fixed=False, lower=-3.0, upper=2.0)
    table = variable_table(CoSimulatedShip.of(product(ship.with_coefficients({"Y_v": known}))))
    (row,) = [row for row in table.rows if row.name == "coefficients.Y_v"]
    assert (row.start, row.lower, row.upper, row.variability) == (known.value, -3.0, 2.0, "tunable")
    assert "std 0.0123" in row.words and "well determined" in row.words


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_the_same_ship_gives_the_same_bytes_and_another_coefficient_another_token(version: int, tmp_path: Path) -> None:
    ship = ship_of("plain")
    write_fmu(product(ship), tmp_path / "again.fmu", version)
    assert (tmp_path / "again.fmu").read_bytes() == fmu("plain", version).read_bytes()
    other = source_fmu(product(ship.with_values({"Y_v": ship.coefficients["Y_v"].value * 1.01})), version, tmp_path)
    documents = [Xml.fromstring(members(path)["modelDescription.xml"]) for path in (fmu("plain", version), other)]
    assert len({one.get("guid" if version == 2 else "instantiationToken") for one in documents}) == 2


@pytest.mark.slow
def test_what_is_logged_late_is_exact_or_said_to_be_near(tmp_path: Path) -> None:
    exact = ship_of("plain").with_effect("velocity_filter", {"tau": 0.4})
    assert CoSimulatedShip.of(product(exact)).late_columns == []
    in_body_axes = exact.with_values({"velocity_filter.body_axes": 1.0})
    assert CoSimulatedShip.of(product(in_body_axes)).late_columns == ["velocity_filter"]
    for name, values in (("gnss_delay", {"tau": 0.3}), ("antenna_offset", {"x": 0.5})):
        near = exact.with_effect(name, values)
        said = write_fmu(product(near), tmp_path / "ship.fmu", 2, ["none"])
        assert has_code(said, LATE_COLUMNS)


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_of_sources_alone_compiles_and_moves(version: int, tmp_path: Path) -> None:
    path, name = source_fmu(product(ship_of("plain")), version, tmp_path), "esso_osaka_3m"
    files = members(path)
    assert not [name for name in files if name.startswith("binaries/")]
    listed = "modelDescription.xml" if version == 2 else "sources/buildDescription.xml"
    elements = Xml.fromstring(files[listed]).iter("File" if version == 2 else "SourceFile")
    sources = [e.get("name") or "" for e in elements]
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(files[file])
    library = tmp_path / "binaries" / (this_platform() if version == 3 else PLATFORMS[this_platform()].folder_2)
    library.mkdir(parents=True)
    command = [compiler() or "cc", "-std=c99", "-shared", "-fPIC", "-I.", *sources, "-lm", "-o"]
    built = library / f"{name}{PLATFORMS[this_platform()].suffix}"
    subprocess.run([*command, str(built)], cwd=tmp_path / "sources", check=True)
    with zipfile.ZipFile(path, "a") as archive:
        archive.write(built, built.relative_to(tmp_path).as_posix())
    with running(path, version) as instance:
        instance.begin({"initial.u": 0.4, "rudder.delta": 0.3, "propeller.n": 8.0})
        for k in range(20):
            instance.fmu.doStep(0.5 * k, 0.5)
        assert instance[["ned_position.yaw"]][0] > 0.05


def test_without_compiler_the_fmu_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MMG_CC", "none")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    said = write_fmu(product(ship_of("plain")), tmp_path / "ship.fmu", 2)
    assert has_code(said, SOURCES_ONLY)
    with monkeypatch.context() as patched:  # one for this platform under another name
        patched.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
        libraries, why = build_here({}, "ship")
    assert libraries == {} and ("MMG_CC" in why or not this_platform())
    with pytest.raises(NotInstalled, match="x86_64-windows"):
        write_fmu(product(ship_of("plain")), tmp_path / "ship.fmu", 2, ["win64"])


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["x86_64-windows", "win64", "aarch64-linux"])
def test_libraries_for_other_platforms(platform: str, tmp_path: Path) -> None:
    try:
        write_fmu(product(ship_of("plain")), tmp_path / "ship.fmu", 3, [platform])
    except NotInstalled as error:
        pytest.skip(str(error))
    windows = ("binaries/x86_64-windows/esso_osaka_3m.dll", b"MZ")
    linux = ("binaries/aarch64-linux/esso_osaka_3m.so", b"\x7fELF")
    name, begins = linux if platform == "aarch64-linux" else windows
    assert members(tmp_path / "ship.fmu")[name].startswith(begins)


def test_platforms_are_known_by_both_names() -> None:
    assert platforms_of(["win64", "x86_64-windows", "linux64"], 2) == ["x86_64-windows", "x86_64-linux"]
    assert platforms_of(["none"], 2) == []
    with pytest.raises(UnknownName, match="amiga"):
        platforms_of(["amiga"], 3)
    with pytest.raises(Conflict):
        platforms_of(["x86_64-darwin", "aarch64-darwin"], 2)


def test_the_description_says_what_is_wrong_with_the_calibration(tmp_path: Path) -> None:
    caveat = Message("its calibration did not converge (Maximum_Iterations_Exceeded)", NOT_CONVERGED)
    of = replace(product(ship_of("plain")), caveats=(caveat,))
    for version in (2, 3):
        root = Xml.fromstring(members(source_fmu(of, version, tmp_path))["modelDescription.xml"])
        assert str(caveat) in (root.get("description") or "")


def test_osp_groups_are_of_variables_that_exist_and_of_the_size_that_a_partner_has(tmp_path: Path) -> None:
    for name in ("esso_osaka_3m", "vectwin_3m"):
        table = variable_table(CoSimulatedShip.of(library_product(name)))
        groups, known = osp_groups(table), {row.name for row in table.rows}
        assert len({name for _, name, _ in groups}) == len(groups)
        assert all(set(variables) <= known for _, _, variables in groups)
        sizes = {name: (kind, len(variables)) for kind, name, variables in groups}
        assert sizes["wind_velocity"] == sizes["velocity"] == ("LinearVelocity", 2)
        assert sizes["ned_position"] == ("LinearDisplacement", 3) and sizes["propeller.n"] == ("Generic", 1)
    source_fmu(product(ship_of("plain")), 2, tmp_path)
    assert (tmp_path / "esso_osaka_3m_OspModelDescription.xml").is_file()
    assert "OspModelDescription" not in " ".join(members(tmp_path / "ship.fmu"))


def test_another_osp_description_is_replaced_by_force_alone(tmp_path: Path) -> None:
    beside = tmp_path / "esso_osaka_3m_OspModelDescription.xml"
    beside.write_text("<another/>")
    of, options = product(ship_of("plain")), {"platforms": ["none"]}
    with pytest.raises(TargetExists, match=beside.name):
        export(of, "fmu", tmp_path / "ship.fmu", **options)
    assert not (tmp_path / "ship.fmu").exists() and beside.read_text() == "<another/>"
    said = export(of, "fmu", tmp_path / "ship.fmu", force=True, **options)
    assert "VariableGroups" in beside.read_text()
    assert [m for m in said if m.code == OSP_DESCRIPTION and beside.name in str(m)]


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_a_written_coefficient_acts_from_the_next_step_on(version: int) -> None:
    ship = ship_of("plain")
    symbol = "coefficients.m_x" if "m_x" in ship.symbols else f"coefficients.{ship.symbols[0]}"
    speeds = []
    for factor in (1.0, 1.3):
        with running(fmu("plain", version), version) as instance:
            instance.begin({"initial.u": 0.4, "propeller.n": 12.0})
            instance.fmu.doStep(0.0, 0.5)
            value = instance[[symbol]][0]
            instance[[symbol]] = [factor * value]
            instance.fmu.doStep(0.5, 0.5)
            assert instance[[symbol]] == [factor * value]
            speeds.append(instance[["body_velocity.surge"]][0])
    assert abs(speeds[0] - speeds[1]) > 1e-6


@pytest.mark.slow
@needs_compiler
def test_it_says_when_it_leaves_what_the_trials_held() -> None:
    with running(fmu("plain", 2), 2) as instance:
        start = {f"initial.{name}": 0.0 for name in STATES} | {"initial.u": 0.5, "propeller.n": 8.0}
        instance.begin(start)
        assert instance.valid() and instance[["extrapolation"]] == [0.0]
        instance.fmu.reset()
        instance.begin(start | {"initial.u": 1.3})
        assert not instance.valid() and instance[["extrapolation"]][0] == pytest.approx(0.5)


@pytest.mark.slow
@needs_compiler
def test_forces_are_those_of_the_model() -> None:
    ship = ship_of("all")
    product_ship = CoSimulatedShip.of(product(ship))
    model = product_ship.model
    with running(fmu("all", 2), 2) as instance:
        start = {"initial.u": 0.4, "initial.v": 0.03, "initial.r": 0.02}
        instance.begin(start | {"propeller.n": 9.0, "rudder.delta": 0.2})
        found = [instance[[f"force.{role}.{axis}" for axis in "XYN"]] for role in model.roles]
    inputs = np.zeros(len(model.controls))
    inputs[[model.controls.index("n"), model.controls.index("delta")]] = 9.0, 0.2
    theta = [c.value for c in product_ship.coefficients]
    state = model.initial([0, 0, 0, 0.4, 0.03, 0.02], inputs, theta)
    assert np.allclose(found, np.array(model.forces(state, inputs, theta)), rtol=1e-11, atol=1e-11)


# The example of docs/how-to/fmu.md steers a ship, and its system description is one that libcosim takes
PAGE = ROOT / "docs" / "how-to" / "fmu.md"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the FMU of the page's first command, in which the tests work."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    command = next(line for line in lines if line.startswith("mmg export"))
    folder = tmp_path_factory.mktemp("example")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(command.split()[1:]) == 0
        yield folder


@pytest.mark.slow
@needs_compiler
def test_the_course_keeper_of_the_page_keeps_its_course(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("fmpy")
    (code,) = blocks(PAGE, "python")
    exec(compile(code, str(PAGE), "exec"), {})
    words = capsys.readouterr().out.split()
    assert words[0] == "heading" and abs(float(words[1]) - 0.5) < 0.02


@pytest.mark.slow
@needs_compiler
def test_libcosim_takes_the_system_of_the_page(exported: Path) -> None:
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution

    (text,) = blocks(PAGE, "xml")
    text = text.replace("wind.fmu", "ship.fmu").replace('name="true_wind"', 'name="velocity"')
    (exported / "OspSystemStructure.xml").write_text(text, encoding="utf-8")
    assert CosimExecution.from_osp_config_file(str(exported)).step(10)


def test_bad_requests_are_one_line_and_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.fmu").write_text("mine")
    for form, out, words, said in (
        ("fmu", "ship.fmu", (), "--force"),
        ("fmu", "there.fmu", ("--force", "--platforms", "amiga"), "amiga"),
        ("fmu", "ship.zip", ("--force",), ".fmu"),
        ("c", "c", ("--force", "--platforms", "win64"), "--platforms"),
    ):
        assert said in refusal("export", "esso_osaka_3m", "--format", form, "--out", out, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["there.fmu"]
    assert (tmp_path / "there.fmu").read_text() == "mine"


# The C code of an FMU by itself: calls in right and wrong orders, saved states, a hundred instances, sanitizers
SANITIZED = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
HERE = Path(__file__).parent


def exercised(kind: str, version: int, command: list[str], folder: Path) -> int:
    """How many claims did not hold in all calls of an FMU compiled from its sources alone."""
    with zipfile.ZipFile(fmu(kind, version)) as archive:
        archive.extractall(folder, [n for n in archive.namelist() if n.startswith("sources/")])
    program = folder / "exercise"
    files = [str(folder / "sources" / "fmu-main.c"), str(HERE / f"exercise_fmi{version}.c")]
    options = ["-std=c99", "-I", str(folder / "sources"), *files, "-o", str(program), "-lm"]
    built = subprocess.run([*command, *STRICT, *options], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    run = subprocess.run([str(program)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    return int(run.stdout.split()[0])


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("kind", ["plain", "all"])
def test_wrong_calls_are_errors_and_saved_states_are_exact(kind: str, version: int, tmp_path: Path) -> None:
    compiler = "clang" if kind == "plain" and shutil.which("clang") else "gcc"
    if shutil.which(compiler) is None:
        pytest.skip("neither gcc nor clang")
    assert exercised(kind, version, [compiler, *SANITIZED], tmp_path) == 0
