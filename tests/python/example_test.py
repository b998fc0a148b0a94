"""The examples run."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import matplotlib.image

SOURCE = pathlib.Path(os.environ["FIELDTRACE_SOURCE"])


class Examples(unittest.TestCase):
    def test_soft_shadows(self):
        with tempfile.TemporaryDirectory() as folder:
            picture = pathlib.Path(folder) / "picture.png"
            subprocess.run([sys.executable, SOURCE / "python/examples/soft_shadows.py", picture], check=True, cwd=folder)
            pixels = matplotlib.image.imread(picture)
        self.assertEqual(pixels.shape[:2], (750, 900))
        self.assertGreater(pixels[:, :, :3].std(), 0.1)

    def test_documents(self):
        examples = re.findall(r"^```python\n(.*?)^```$", (SOURCE / "docs/python.md").read_text(), re.M | re.S)
        self.assertTrue(examples)
        for text in examples:
            subprocess.run([sys.executable, "-c", text], check=True, cwd=SOURCE)


if __name__ == "__main__":
    unittest.main()
