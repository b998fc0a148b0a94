"""Visibility, nearest hits and pictures by displacement fields; the C interface for numpy."""

from ._core import Error, Scene

__all__ = ["Error", "Scene", "render"]

CLEAR, BLOCKED, UNDECIDED = 0, 1, 2


def render(path, spp=0, threads=0, **settings):
    """Renders a scene file: linear radiance, float32 of shape (height, width, 3), row 0 at the top.

    `settings` are the names of ftSetSceneInt, and `tolerance`. Raises Error with the library's message.
    """
    scene = Scene(str(path), threads)
    scene.set("spp", spp)
    for name, value in settings.items():
        if name == "tolerance":
            scene.set_float(name, value)
        else:
            scene.set(name, value)
    scene.commit()
    return scene.render()
