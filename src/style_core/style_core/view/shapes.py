"""Meshes of extent 1 that parts are scaled from."""
import numpy as np

__all__ = ['UNIT', 'box', 'cylinder', 'solid', 'sphere']

#: diameter of the ball at the end of a bone, in widths of the bone
_BALL = {'bone': 1.15, 'head': 4.1}


def box():
    """Vertices, shape (8, 3), and faces, shape (12, 3), of the cube of edge 1 about the origin."""
    vertices = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, _triangles(quads)


def cylinder(count=14):
    """A cylinder of diameter and height 1 along z, with ``count`` corners; outsides of faces turn left."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.c_[ring, np.full(count, z)] for z in (-0.5, 0.5)] + [[[0, 0, -0.5], [0, 0, 0.5]]])
    after = np.roll(np.arange(count), -1)
    faces = [face for a, b in zip(range(count), after) for face in (
        (a, b, b + count), (a, b + count, a + count), (b, a, 2 * count), (a + count, b + count, 2 * count + 1))]
    return vertices.astype(np.float32), np.array(faces, np.uint32)


def sphere(rings=8, count=14):
    """A sphere of diameter 1."""
    polar = np.pi * np.arange(1, rings) / rings
    angle = 2 * np.pi * np.arange(count) / count
    grid = np.stack(np.broadcast_arrays(np.sin(polar)[:, None] * np.cos(angle), np.sin(polar)[:, None] * np.sin(angle),
                                        np.cos(polar)[:, None]), axis=-1).reshape(-1, 3)
    vertices = 0.5 * np.concatenate([grid, [[0, 0, 1], [0, 0, -1]]])
    top, bottom, last = len(grid), len(grid) + 1, (rings - 2) * count
    faces = []
    for a, b in zip(range(count), np.roll(np.arange(count), -1)):
        faces += [(top, a, b), (last + b, last + a, bottom)]
        for row in range(0, last, count):
            faces += [(row + a, row + count + a, row + count + b), (row + a, row + count + b, row + b)]
    return vertices.astype(np.float32), np.array(faces, np.uint32)


def _triangles(quads):
    return np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], np.uint32)


#: shape -> function that makes its mesh
UNIT = {'box': box, 'cylinder': cylinder, 'sphere': sphere}


def solid(shape, size):
    """Vertices, shape (V, 3), and faces, shape (F, 3), of a part of a `Figure` with extents ``size``, shape (3,), m."""
    size = np.asarray(size, dtype=np.float32)
    if shape not in _BALL:
        vertices, faces = UNIT[shape]()
        return vertices * size, faces
    (rod, rod_faces), (ball, ball_faces) = cylinder(), sphere()
    ball = ball * np.float32(_BALL[shape]) * size[0] + np.array([0, 0, size[2] / 2], np.float32)
    return np.concatenate([rod * size, ball]), np.concatenate([rod_faces, ball_faces + np.uint32(len(rod))])
