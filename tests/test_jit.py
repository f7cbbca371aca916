"""A first start must not wait long, and nothing may be compiled in flight."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNELS = """
from gcs.jit import kernel

@kernel
def one(x):
    return x + 1

@kernel
def two(x):
    return x + 2

def warm_up_calls():
    return [(one, 1), (two, 1)]
"""


PARTS = """
from gcs.jit import kernel, leaf

@leaf
def part(x):
    return x + 1

@kernel
def one(x):
    return part(x) * 2

@kernel
def two(x):
    return one(x) + part(x)

def warm_up_calls():
    return [(one, 1), (two, 1)]
"""


def run(code: str, folder: Path) -> str:
    """Run code in a fresh process, with a cache of its own."""
    path = os.pathsep.join([str(folder), *sys.path])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.mark.parametrize("helper", ["sys.executable", "'/nowhere/python'", "'false'"])
def test_a_cold_start_caches_everything_even_without_its_helper(tmp_path, helper):
    (tmp_path / "alpha.py").write_text(KERNELS)
    run(
        f"import sys; sys.executable = {helper}; from gcs import jit; jit.warm_up('alpha')",
        tmp_path,
    )
    again = "import alpha; print([f(x) for f, x in alpha.warm_up_calls()], alpha.one.stats, alpha.two.stats)"
    output = run(again, tmp_path)
    assert output.startswith("[2, 3]")
    assert output.count("cache_misses=Counter()") == 2


def test_parts_are_optimised_once_in_the_kernels_that_call_them(tmp_path):
    (tmp_path / "alpha.py").write_text(PARTS)
    code = """
from collections import Counter
from numba.core import codegen
passes, made = Counter(), []
manager, add = codegen.JITCPUCodegen._module_pass_manager, codegen.JitEngine.add_module
def counted(self, **options):
    passes["cheap" if options else "full"] += 1
    return manager(self, **options)
def noted(self, module):
    made.append(module.name)
    return add(self, module)
codegen.JITCPUCodegen._module_pass_manager, codegen.JitEngine.add_module = counted, noted
import alpha
one, two = (compiled(x) for compiled, x in alpha.warm_up_calls())
print(one, two, sorted(made), passes["full"])  # "nrt" is the library that counts references
"""
    assert run(code, tmp_path) == "4 6 ['nrt', 'one', 'two'] 3"
    assert run("import alpha; print([f(x) for f, x in alpha.warm_up_calls()])", tmp_path) == "[4, 6]"


def test_one_helper_compiles_all_modules_from_the_other_end(tmp_path):
    for name in ("alpha", "beta"):
        (tmp_path / f"{name}.py").write_text(KERNELS)
    code = """
import subprocess
started = []
class Popen(subprocess.Popen):
    def __init__(self, command, **options):
        started.append(command[4:])
        super().__init__(command, **options)
subprocess.Popen = Popen
from gcs import jit
reports = []
jit.warm_up("alpha", "beta", on_compiled=lambda *report: reports.append(report))
print(started, reports[0])
"""
    assert run(code, tmp_path) == "[['alpha', 'beta']] ('alpha', 1, 2)"
    again = "import alpha, beta; print([f(1) for m in (alpha, beta) for f in (m.one, m.two)],"
    again += " sum(f.stats.cache_misses.total() for m in (alpha, beta) for f in (m.one, m.two)))"
    assert run(again, tmp_path) == "[2, 3, 2, 3] 0"


def test_a_cold_start_is_announced_and_a_warm_one_is_not(tmp_path):
    (tmp_path / "alpha.py").write_text(KERNELS)
    start = "from rich.console import Console; from gcs.cli.warm_up_progress import load_kernels;"
    start += "load_kernels(Console(), 'alpha')"
    first, *rest = run(start, tmp_path).splitlines()
    assert first.startswith("compiling the kernels, once after an installation: half a minute on two")
    assert "gcs warm-up" in " ".join([first, *rest])
    reports = [" ".join(line.split()[:2]) for line in rest if line.startswith("compil")]
    assert reports == ["compiling 2", "compiled in"]
    assert run(start, tmp_path) == ""


def test_a_check_compiles_nothing_and_a_start_after_an_interrupted_one_is_announced(tmp_path):
    (tmp_path / "alpha.py").write_text(KERNELS)
    cached = "jit.is_cached('alpha')"
    before = f"from gcs import jit; print({cached}); from alpha import one; one(1); print({cached})"
    assert run(before, tmp_path).split() == ["False", "False"]
    reports = "reports = []; jit.warm_up('alpha', on_compiled=lambda *report: reports.append(report))"
    told = run(f"from gcs import jit; {reports}; print(reports); print({cached})", tmp_path)
    assert told.splitlines() == ["[('alpha', 1, 2), ('alpha', 2, 2)]", "True"]


def test_a_warm_start_does_not_load_the_compiler_but_can_compile(
    tmp_path,
):
    (tmp_path / "alpha.py").write_text(KERNELS)
    run("from alpha import one; one(1)", tmp_path)
    output = run(
        "import sys; from alpha import one, two; print(one(1), 'numba.np.arrayobj' in sys.modules, two(1))",
        tmp_path,
    )
    assert output.split() == ["2", "False", "3"]


def test_cached_tracking_kernels_do_not_load_the_compiler():
    code = "import sys; from gcs.tracking.glmb.filter import warm_up; warm_up();"
    code += "print([name for name in ('numba.np.arraymath', 'scipy.linalg') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_cache_with_names_that_moved_is_renewed(tmp_path):
    kernels = """
from gcs.jit import kernel
from MODULE import Pair

@kernel
def total(pair):
    return pair.a + pair.b
"""
    pair = "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    a: int\n    b: int\n"
    for module in ("before", "after"):
        (tmp_path / f"{module}.py").write_text(pair)
        (tmp_path / "before.py").write_text(pair if module == "before" else "")
        (tmp_path / "alpha.py").write_text(kernels.replace("MODULE", module))
        use = f"from alpha import total; from {module} import Pair; print(total(Pair(1, 2)), total.stats)"
        assert run(use, tmp_path).startswith("3 ")
    assert run(use, tmp_path).endswith("cache_misses=Counter())")


def test_no_plan_compiles_anything_after_the_warm_up():
    program = Path(__file__).parent / "planning" / "in_flight.py"
    done = subprocess.run([sys.executable, "-P", program], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_tests_that_call_no_kernel_wait_for_no_compilation(tmp_path):
    """In a fresh clone such a test takes seconds, not minutes."""
    pure = [
        str(Path(__file__).parent / one) for one in ("test_geo.py", "sim_vehicles/vehicle/test_geodesy.py")
    ]
    run(
        f"import pytest, sys; sys.exit(pytest.main(['-n', '0', '-p', 'no:cacheprovider', *{pure}]))",
        tmp_path,
    )
    assert not list((tmp_path / "cache").rglob("*.nb?"))


REPORTING = "filterpy", "scipy.stats", "matplotlib"


@pytest.mark.parametrize(
    ("start", "unused"),
    [
        ("gcs.cli.fly.demo_flight", REPORTING),
        ("gcs.cli.fly.live_service", REPORTING),
        ("gcs.cli.fly.demo_simulation", (*REPORTING, "numba", "scipy")),
        ("sim_vehicles.vehicle.vehicle_process", (*REPORTING, "numba", "scipy")),
        ("sim_vehicles.world.world_process", (*REPORTING, "numba", "scipy")),
    ],
)
def test_a_flight_starts_without_libraries_that_it_does_not_need(start, unused):
    """They take as long to import as a quarter of all else, and half of the simulated world."""
    code = f"import sys, {start}; print([name for name in {unused} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
