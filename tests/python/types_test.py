"""Stubs and annotations are those of the package, and users' code is checked by them."""

import ast
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

from fieldtrace import _core

# What stubtest takes for errors in classes and functions of nanobind; parameters are compared here instead.
NANOBIND = "fieldtrace._core.Scene\nfieldtrace._core.Scene.load\nfieldtrace._core.version\n"
HERE = pathlib.Path(__file__).resolve().parent


class Types(unittest.TestCase):
    def run_python(self, *arguments):
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "nanobind").write_text(NANOBIND)
            environment = {**os.environ, "MYPY_CACHE_DIR": folder, "PYTHONPATH": ""}
            result = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=folder,
                                    env=environment)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)

    def test_stubs_are_those_of_the_module(self):
        self.run_python("mypy.stubtest", "fieldtrace", "--allowlist", "nanobind")

    def test_parameters_of_the_extension(self):
        stub = ast.parse(pathlib.Path(_core.__file__).with_name("_core.pyi").read_text())
        (scene,) = (node for node in stub.body if isinstance(node, ast.ClassDef))
        functions = [node for node in scene.body if isinstance(node, ast.FunctionDef)]
        self.assertGreater(len(functions), 20)
        for function in functions:
            (overload,) = getattr(_core.Scene, function.name).__nb_signature__
            signature = re.sub(r"\[[^\]]*\]", "", overload[0]).split(" -> ")[0]
            names = [p.split(":")[0] for p in signature[signature.index("(") + 1 : -1].split(", ")]
            expected = [argument.arg for argument in function.args.args]
            self.assertEqual(names, expected, overload[0])

    def test_package(self):
        self.run_python("mypy", "--strict", "-p", "fieldtrace")

    def test_users_code(self):
        self.run_python("mypy", "--strict", str(HERE / "typed_program.py"))


if __name__ == "__main__":
    unittest.main()
