"""From kernels to object code: the module that numba makes of the entries, and what llvmlite makes of that anywhere.

Run as a program in a process of its own, it compiles for any processor of this machine's kind, not for this one, and
writes the module's text. The text is taken before numba hands it to its engine, which would put this machine's
instructions into it. Nothing in it may fuse or reorder floating-point operations, so that every target computes the
same bits.
"""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from sidestep.fmu.compiling.cache import cached
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import PlantError
from sidestep.plant_models.kernels import source_stamp

PREFIX = "sidestep_kernel_"
_ENTRIES = Path(__file__).with_name("entries.py")
_PROCESSOR = {"x86_64": "x86-64", "aarch64": "generic", "arm64": "generic"}
_COUNTING = re.compile(r"^define [^@\n]*@(NRT_incref|NRT_decref)\(ptr[^)]*\)[^{\n]*\{.*?^\}$", re.MULTILINE | re.DOTALL)
_NO_COUNTING = r"define linkonce_odr void @\1(ptr %p) alwaysinline {\n  ret void\n}"


def object_code(triple: str) -> bytes:
    """The entries as a relocatable object file.

    Args:
        triple: Of the target, as LLVM calls it.

    Raises:
        InputError: The cache cannot be written.
        PlantError: numba does not compile them.
    """
    key = kernels_stamp()
    name = triple.replace("-", "_")
    return cached(f"kernels-{key}-{name}", ".o", lambda: _emit(_module(key), triple)).read_bytes()


def kernels_stamp() -> str:
    """Changes with every source that kernels come from, and with the compilers' versions."""
    return source_stamp(_ENTRIES)[:16]


def _module(key: str) -> str:
    return cached(f"kernels-{key}", ".ll", _compile).read_text(encoding="utf-8")


def _compile() -> bytes:
    """The text of the module, from a process whose numba knows no processor."""
    folder = scratch_folder("build")
    try:
        out = folder / "kernels.ll"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
        environment |= {"NUMBA_CPU_NAME": _PROCESSOR[platform.machine()], "NUMBA_CPU_FEATURES": ""}
        environment |= {n: v for n, v in os.environ.items() if n == "NUMBA_CACHE_DIR"}
        command = [sys.executable, "-m", "sidestep.fmu.component.emit", str(out)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=False)
        if done.returncode:
            said = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            raise PlantError(f"the controller's step does not compile: {said}")
        return out.read_bytes()
    finally:
        discard(folder)


def _emit(text: str, triple: str) -> bytes:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    processor = _PROCESSOR[triple.partition("-")[0]]
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=processor, opt=3, reloc="pic", codemodel="small"
    )
    text = re.sub(r"^target triple = .*$", f'target triple = "{triple}"', text, flags=re.MULTILINE)
    text = re.sub(r"^target datalayout = .*$", f'target datalayout = "{machine.target_data}"', text, flags=re.MULTILINE)
    module = llvm.parse_assembly(text)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


def main(out: Path) -> None:
    """Compile every entry and write them as one module."""
    import numba
    from numba.core import codegen

    from sidestep.fmu.component.entries import ENTRIES

    texts: dict[str, str] = {}
    libraries: Any = codegen.CPUCodeLibrary
    finalise = libraries._finalize_final_module

    def keep(library: Any) -> None:
        texts[library.name] = str(library._final_module)
        finalise(library)

    libraries._finalize_final_module = keep
    whole = None
    for name, (function, signature) in ENTRIES.items():
        compiled: Any = numba.cfunc(signature)(function)
        module = llvm.parse_assembly(_prepared(texts[compiled._library.name], compiled.native_name, PREFIX + name))
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    out.write_text(_closed(str(whole)), encoding="utf-8")


def _prepared(text: str, symbol: str, name: str) -> str:
    """One entry's module under a C name, without reference counts: what it takes is given back as a whole."""
    text = _COUNTING.sub(_NO_COUNTING, text)
    text = re.sub(r"^declare [^\n]*@llvm\.x86[^\n]*$", "", text, flags=re.MULTILINE)
    return text.replace(f'"{symbol}"', name).replace(f"@{symbol}", f"@{name}")


def _closed(text: str) -> str:
    """Only the entries can be seen from outside."""
    text = re.sub(r" = common (local_unnamed_addr )?global", " = internal global", text)
    text = re.sub(r" = linkonce_odr ", " = internal ", text)
    text = re.sub(r"@(?=NRT_|Py|numba_)", "@sidestep_", text)  # those of arena.c, not a Python's that is there, too
    text = re.sub(r"^define (linkonce_odr )?", "define internal ", text, flags=re.MULTILINE)
    return re.sub(rf"^define internal (?=[^@\n]*@{PREFIX})", "define hidden ", text, flags=re.MULTILINE)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
