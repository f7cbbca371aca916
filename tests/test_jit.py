"""A first start waits seconds, not half a minute; no later one compiles anything, in flight least of all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOM = """
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
def test_a_cold_start_leaves_everything_in_the_cache_whatever_becomes_of_its_helper(tmp_path, helper):
    (tmp_path / "room.py").write_text(ROOM)
    run(
        f"import sys; sys.executable = {helper}; from gcs import jit; jit.warm_up('room')",
        tmp_path,
    )
    again = "import room; print([f(x) for f, x in room.warm_up_calls()], room.one.stats, room.two.stats)"
    said = run(again, tmp_path)
    assert said.startswith("[2, 3]")
    assert said.count("cache_misses=Counter()") == 2


def test_what_kernels_call_is_optimised_and_made_machine_code_once_within_them(tmp_path):
    (tmp_path / "room.py").write_text(PARTS)
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
import room
one, two = (compiled(x) for compiled, x in room.warm_up_calls())
print(one, two, sorted(made), passes["full"])  # "nrt" is the library that counts references
"""
    assert run(code, tmp_path) == "4 6 ['nrt', 'one', 'two'] 3"
    assert run("import room; print([f(x) for f, x in room.warm_up_calls()])", tmp_path) == "[4, 6]"


def test_one_helper_goes_through_all_that_is_cold_from_the_other_end(tmp_path):
    for name in ("room", "hall"):
        (tmp_path / f"{name}.py").write_text(ROOM)
    code = """
import subprocess
started = []
class Popen(subprocess.Popen):
    def __init__(self, command, **options):
        started.append(command[4:])
        super().__init__(command, **options)
subprocess.Popen = Popen
from gcs import jit
told = []
jit.warm_up("room", "hall", on_compiled=lambda *words: told.append(words))
print(started, told[0])
"""
    assert run(code, tmp_path) == "[['room', 'hall']] ('room', 1, 2)"
    again = "import room, hall; print([f(1) for r in (room, hall) for f in (r.one, r.two)],"
    again += " sum(f.stats.cache_misses.total() for r in (room, hall) for f in (r.one, r.two)))"
    assert run(again, tmp_path) == "[2, 3, 2, 3] 0"


def test_a_cold_start_is_told_before_it_takes_its_time_and_a_warm_one_is_not(tmp_path):
    (tmp_path / "room.py").write_text(ROOM)
    start = "from rich.console import Console; from gcs.cli.warm_up_progress import load_kernels;"
    start += "load_kernels(Console(), 'room')"
    first, *rest = run(start, tmp_path).splitlines()
    assert first.startswith("compiling the kernels, once after an installation: one to two minutes")
    assert "gcs warm-up" in " ".join([first, *rest])
    told = [" ".join(line.split()[:2]) for line in rest if line.startswith("compil")]
    assert told == ["compiling 2", "compiled in"]
    assert run(start, tmp_path) == ""


def test_a_later_start_does_not_wait_for_the_compiler_and_what_is_not_in_the_cache_is_still_compiled(
    tmp_path,
):
    (tmp_path / "room.py").write_text(ROOM)
    run("from room import one; one(1)", tmp_path)
    said = run(
        "import sys; from room import one, two; print(one(1), 'numba.np.arrayobj' in sys.modules, two(1))",
        tmp_path,
    )
    assert said.split() == ["2", "False", "3"]


def test_no_kernel_of_the_trackers_has_numba_prepare_to_compile_where_all_are_in_the_cache():
    code = "import sys; from gcs.tracking.glmb.filter import warm_up; warm_up();"
    code += "print([name for name in ('numba.np.arraymath', 'scipy.linalg') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_cache_that_names_what_an_upgrade_moved_is_renewed(tmp_path):
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
        (tmp_path / "room.py").write_text(kernels.replace("MODULE", module))
        use = f"from room import total; from {module} import Pair; print(total(Pair(1, 2)), total.stats)"
        assert run(use, tmp_path).startswith("3 ")
    assert run(use, tmp_path).endswith("cache_misses=Counter())")


def test_no_plan_compiles_anything_after_the_warm_up():
    program = Path(__file__).parent / "planning" / "in_flight.py"
    done = subprocess.run([sys.executable, "-P", program], capture_output=True, text=True, check=True)
    assert done.stdout == ""
