"""What the library refuses comes as exceptions with its messages."""

import os
import pathlib
import tempfile
import unittest
import warnings

import numpy as np

import fieldtrace
from fieldtrace import ErrorCode, InputError, InvalidArgument, InvalidOperation, OutOfMemory, Scene
from shapes import sheet, torus


class Errors(unittest.TestCase):
    def committed(self, mesh=sheet, **settings):
        scene = Scene()
        scene.set(**settings)
        scene.add_instance(scene.add_mesh(*mesh()))
        scene.commit()
        return scene

    def test_messages_and_codes(self):
        scene = self.committed()
        ray = ([0, 1, 0], [0, -1, 0])
        calls = [
            (InvalidOperation, r"ftOccluded: the scene is not committed", lambda: Scene().occluded(*ray)),
            (InvalidOperation, "has no instances", lambda: Scene().commit()),
            (InvalidOperation, "ftAddMesh: only before the first commit", lambda: scene.add_mesh(*sheet())),
            (InvalidOperation, "only before the first commit", lambda: scene.set(plane=128)),
            (InvalidArgument, "ray 1 has numbers that are not finite", lambda: scene.occluded([ray[0], [np.nan] * 3], ray[1])),
            (InvalidArgument, "ray 0 has .* no direction", lambda: scene.occluded(ray[0], [0, 0, 0])),
            (InvalidArgument, "leaves an instance that is not there", lambda: scene.occluded(*ray, 1, 7)),
            (InvalidArgument, "max_error must lie within", lambda: scene.nearest(*ray, max_error=0)),
            (InvalidArgument, 'there is no integer "nothing"', lambda: scene.set(nothing=1)),
            (InvalidArgument, 'there is no integer "nothing"', lambda: scene.get("nothing")),
            (InvalidArgument, r'"tolerance" must lie within \[0, 1\]', lambda: scene.set(tolerance=2)),
            (InvalidArgument, "more than 1024 threads", lambda: Scene(2000)),
            (InvalidArgument, "cannot be inverted", lambda: scene.set_transform(0, np.zeros((3, 4)))),
            (InvalidArgument, "refers to a position", lambda: Scene().add_mesh(sheet()[0], [[0, 1, 9]])),
            (InvalidArgument, "there is no mesh 3", lambda: Scene().add_instance(3)),
            (InvalidArgument, "has no field", lambda: scene.save_field(0, "a.vdb")),
            (InvalidArgument, "reflectance is more than 1", lambda: scene.set_reflectance(0, 2)),
            (InputError, "/nowhere/scene.xml: cannot be read", lambda: fieldtrace.load_scene("/nowhere/scene.xml")),
            (InputError, "/nowhere/scene.xml: cannot be read", lambda: fieldtrace.render("/nowhere/scene.xml", spp=16)),
            (InputError, "/nowhere", lambda: scene.render_to_file("/nowhere/picture.png")),
        ]
        for kind, message, call in calls:
            with self.subTest(message):
                with self.assertRaisesRegex(kind, message) as caught:
                    call()
                self.assertIsInstance(caught.exception, fieldtrace.Error)
                self.assertEqual(caught.exception.code, kind.code)
        # It goes on.
        self.assertTrue(scene.occluded(*ray))

    def test_natural_bases(self):
        self.assertTrue(issubclass(fieldtrace.Error, RuntimeError))
        self.assertTrue(issubclass(InvalidArgument, ValueError))
        self.assertTrue(issubclass(OutOfMemory, MemoryError))
        self.assertEqual(ErrorCode.CANCELLED, 5)

    def test_damaged_and_foreign_files(self):
        scene = self.committed(torus, directions=32, plane=64)
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "field.vdb"
            file.write_bytes(b"no field")
            with self.assertRaisesRegex(InputError, "field.vdb"):
                scene.load_field(0, file)
            # A name that is no UTF-8 comes back as it was given.
            name = os.fsdecode(os.fsencode(folder) + b"/\xff.xml")
            with self.assertRaises(InputError) as caught:
                fieldtrace.load_scene(name)
            self.assertIn(name, str(caught.exception))

    def test_little_memory(self):
        with self.assertRaises(fieldtrace.Error):
            self.committed(torus, field_memory=1000, directions=32, plane=64).bake()

    def test_what_a_file_says_in_vain_warns(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "scene.xml"
            file.write_text(
                '<scene version="3.0.0"><emitter type="constant"/>'
                '<shape type="sphere"><bsdf type="velvet"/></shape></scene>'
            )
            with self.assertWarnsRegex(UserWarning, "scene.xml:1: .*velvet") as caught:
                fieldtrace.load_scene(file)
            self.assertEqual(caught.filename, __file__)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                with self.assertRaises(UserWarning):
                    fieldtrace.render(file)

    def test_errors_of_progress(self):
        scene = self.committed(torus, directions=32, plane=64)

        def fails(share):
            raise KeyError("mine")

        with self.assertRaisesRegex(KeyError, "mine"):
            scene.bake(fails)
        with self.assertRaises(TypeError):
            scene.bake(1)
        self.assertEqual(scene.occluded([0, 0, 9], [0, 0, 1]), False)


if __name__ == "__main__":
    unittest.main()
