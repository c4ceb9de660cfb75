"""Edge collapses ordered by quadrics, each looked at anew every time: the obvious twin of native/simplify.cpp.

For faces of any shape (quality 0), one group and no values: what is left are collapses, then flips.
"""

import itertools

import numpy as np

from oracles.proximity import cut, distance

ROUND, TURN, FLIP_TURN = 1e-4, 0.4, 0.9


class Simplification:
    """A mesh as a dict of faces by number, with what it keeps of the original."""

    def __init__(self, vertices, faces, tolerance):
        self.places = {v: at.astype(np.float64) for v, at in enumerate(vertices)}
        self.faces = {number: tuple(face) for number, face in enumerate(faces.tolist())}
        self.tolerance = tolerance
        self.quadrics = {v: np.zeros((4, 4)) for v in self.places}
        self.areas = dict.fromkeys(self.places, 0.0)
        for face in self.faces.values():
            normal = self._normal(face)
            plane = np.append(normal, -normal @ self.places[face[0]]) / np.linalg.norm(normal)
            weight = np.linalg.norm(normal) / 6
            for corner in face:
                self.quadrics[corner] += weight * np.outer(plane, plane)
                self.areas[corner] += weight
        middles = {number: self._corners(face).mean(axis=0) for number, face in self.faces.items()}
        self.points = {number: [middle] for number, middle in middles.items()}
        told = set()
        for number, face in self.faces.items():
            self.points[number] += [self.places[v] for v in face if v not in told]
            told |= set(face)

    def collapse(self, wanted):
        """Collapse the cheapest edge that may be, until as many faces are left as wanted or none may be."""
        refused = set()
        while len(self.faces) > wanted:
            edges = {tuple(sorted((f[i], f[i - 1]))) for f in self.faces.values() for i in range(3)} - refused
            if not edges:
                return
            cheapest = min(edges, key=lambda edge: (self._cost(*edge)[0], edge))
            if self._merge(*cheapest):
                refused = {edge for edge in refused if cheapest[1] not in edge}  # it has changed: they may be now
            else:
                refused.add(cheapest)

    def flip(self):
        """Once round: the other diagonal of two faces, where that makes the worse of them better."""
        for number in sorted(self.faces):
            for edge in range(3):
                self._flip(number, edge)

    def _flip(self, first, edge):
        a, b, c = (self.faces[first][(edge + step) % 3] for step in range(3))
        second = next(n for n, f in self.faces.items() if any((f[i], f[(i + 1) % 3]) == (b, a) for i in range(3)))
        d = next(v for v in self.faces[second] if v not in (a, b))
        left, right = (a, d, c), (d, b, c)
        before = min(self._quality(self.faces[first]), self._quality(self.faces[second]))
        poor = len(self._round(a)) <= 3 or len(self._round(b)) <= 3
        joined = any({c, d} <= set(face) for face in self.faces.values())
        if poor or joined or not min(self._quality(left), self._quality(right)) > 1.01 * before:
            return
        for old in (self._normal(self.faces[first]), self._normal(self.faces[second])):
            for new in (self._normal(left), self._normal(right)):
                if old @ new < FLIP_TURN * np.linalg.norm(old) * np.linalg.norm(new):
                    return
        self._replace({first: left, second: right}, [first, second], {})

    def _merge(self, first, second):
        _, best = self._cost(first, second)
        shared = set.intersection(*({v for n in self._round(end) for v in self.faces[n]} for end in (first, second)))
        if len(shared - {first, second}) != 2 or any(len(self._round(v)) <= 3 for v in shared - {first, second}):
            return False
        gone = sorted({*self._round(first), *self._round(second)})
        for goal in (best, self.places[second], self.places[first]):
            goal = goal.astype(np.float32).astype(np.float64)
            come = {n: tuple(second if v == first else v for v in self.faces[n]) for n in gone}
            come = {n: face for n, face in come.items() if len(set(face)) == 3}
            before = {n: self._normal(self.faces[n]) for n in come}
            if self._replace(come, gone, {first: goal, second: goal}, before):
                self.quadrics[second] = self.quadrics[first] + self.quadrics[second]
                self.areas[second] += self.areas[first]
                del self.places[first]
                return True
        return False

    def _replace(self, come, gone, moved, before=None):
        """Do it where it is allowed: no face turned, no point of the original too far, no face cut."""
        kept = self.places | moved
        corners = {n: np.array([kept[v] for v in face]) for n, face in come.items()}
        for n, old in (before or {}).items():
            new = np.cross(corners[n][1] - corners[n][0], corners[n][2] - corners[n][0])
            if not old @ new > TURN * np.linalg.norm(old) * np.linalg.norm(new):
                return False
        heirs = {n: [] for n in come}
        for number in gone:
            for point in self.points[number]:
                near = {n: distance(point, at) for n, at in corners.items()}
                nearest = min(near, key=near.get)
                if near[nearest] > self.tolerance:
                    return False
                heirs[nearest].append(point)
        rest = [self._corners(face) for n, face in self.faces.items() if n not in gone]
        pairs = [*itertools.combinations(corners.values(), 2), *itertools.product(corners.values(), rest)]
        if any(_boxes_meet(*pair) and cut(*pair) for pair in pairs):
            return False
        self.places = kept
        for number in gone:
            del self.faces[number], self.points[number]
        self.faces |= come
        self.points |= heirs
        return True

    def _cost(self, first, second):
        """Of a collapse, and the best place: the least error, drawn a little towards the middle of the edge."""
        total, middle = self.quadrics[first] + self.quadrics[second], (self.places[first] + self.places[second]) / 2
        pull = ROUND * (self.areas[first] + self.areas[second])
        best = np.linalg.solve(total[:3, :3] + pull * np.eye(3), pull * middle - total[:3, 3])
        at = np.append(best, 1)
        edge = self.places[first] - self.places[second]
        return max(at @ total @ at, 0) + min(self.areas[first], self.areas[second]) * ROUND * (edge @ edge), best

    def _round(self, vertex):
        return [number for number, face in self.faces.items() if vertex in face]

    def _corners(self, face):
        return np.array([self.places[v] for v in face])

    def _normal(self, face):
        a, b, c = self._corners(face)
        return np.cross(b - a, c - a)

    def _quality(self, face):
        a, b, c = self._corners(face)
        return 2 * np.sqrt(3) * np.linalg.norm(self._normal(face)) / sum(e @ e for e in (b - a, c - b, a - c))


def _boxes_meet(first, second):
    return bool((first.min(axis=0) <= second.max(axis=0)).all() and (second.min(axis=0) <= first.max(axis=0)).all())
