"""Normals of a point cloud: directions from each point's neighbours, sides propagated between neighbours."""

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree


def point_normals(points: Float[np.ndarray, "p 3"], neighbours: int = 12) -> Float32[np.ndarray, "p 3"]:
    """Unit normals of points on a surface, pointing outwards (Hoppe et al. 1992).

    A normal is the direction in which a point's neighbours spread least. Its side follows that of the neighbour whose
    plane is most alike, along a spanning tree; each connected part looks away from its middle on the whole, as a closed
    or bulging one does. What is hollow to the eye, such as a bowl seen from above, comes out the wrong way round.

    Raises:
        ValueError: fewer than four points.
    """
    if len(points) < 4:
        raise ValueError(f"{len(points)} points say nothing of a surface: four is the least.")
    near = np.asarray(cKDTree(points).query(points, k=min(neighbours, len(points)))[1])
    normals = _least_spread(points.astype(np.float64), near)
    return _one_sided(points.astype(np.float64), normals, near).astype(np.float32)


def _least_spread(points: Float64[np.ndarray, "p 3"], near: Int64[np.ndarray, "p k"]) -> Float64[np.ndarray, "p 3"]:
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("pki,pkj->pij", around, around))[1][:, :, 0]


def _one_sided(
    points: Float64[np.ndarray, "p 3"], normals: Float64[np.ndarray, "p 3"], near: Int64[np.ndarray, "p k"]
) -> Float64[np.ndarray, "p 3"]:
    count, width = near.shape
    rows, columns = np.arange(near.size) // width, near.ravel()
    alike = np.abs((normals[rows] * normals[columns]).sum(axis=1))
    cost = np.where(rows == columns, 0.0, 1.0 + 1e-3 - np.minimum(alike, 1.0))
    graph = coo_array((cost, (rows, columns)), shape=(count, count)).tocsr()
    graph.eliminate_zeros()
    tree = minimum_spanning_tree(graph.minimum(graph.T) + (graph - graph.T).maximum(0))
    tree = tree + tree.T
    parts, part = connected_components(tree, directed=False)
    turned = normals.copy()
    for number in range(parts):
        members = np.flatnonzero(part == number)
        out = points[members] - points[members].mean(axis=0)
        seed = int(np.argmax((out**2).sum(axis=1)))
        order, before = breadth_first_order(tree, members[seed], directed=False)
        for point in order[1:]:
            if turned[point] @ turned[before[point]] < 0:
                turned[point] *= -1
        if (turned[members] * out).sum() < 0:  # of a closed surface: three times the volume that it holds
            turned[members] *= -1
    return turned
