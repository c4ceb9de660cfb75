"""The one I/O layer: strict readers that raise FileError and nothing else, and writers that never leave half a file."""

from goc.files.any_mesh import MESH_SUFFIXES, read_any_mesh, welded
from goc.files.atomic import move_file, write_atomic, write_bytes
from goc.files.documents import as_json, read_json, read_matrix, read_versioned, write_json
from goc.files.evidence import read_evidence, write_evidence
from goc.files.glb import write_glb
from goc.files.images import (
    MILLIMETRES,
    image_size,
    picture_size,
    read_codes,
    read_ids,
    read_image,
    read_normals,
    read_picture,
    write_depth,
    write_ids,
    write_image,
    write_normals,
    write_png,
)
from goc.files.layout import ObjectFiles, object_files, object_ids
from goc.files.meshes import read_mesh, read_observed_mesh, read_points, write_mesh, write_points
from goc.files.ply import Lists, read_ply, write_ply
from goc.files.rasters import depth_of, raster_size, read_depth, read_raster
from goc.files.raw_points import Scan
from goc.files.reading import is_file, is_folder, read_bytes
from goc.files.scans import SCAN_SUFFIXES, read_scan
from goc.files.scene_folder import SurfaceKind, read_meshes, read_scene, write_meshes, write_scene
from goc.files.splats import read_splats, write_splats
from goc.files.tensors import read_tensors, write_tensors

__all__ = [
    "MESH_SUFFIXES",
    "MILLIMETRES",
    "Lists",
    "ObjectFiles",
    "SCAN_SUFFIXES",
    "Scan",
    "SurfaceKind",
    "as_json",
    "depth_of",
    "image_size",
    "is_file",
    "is_folder",
    "move_file",
    "object_files",
    "object_ids",
    "picture_size",
    "raster_size",
    "read_any_mesh",
    "read_bytes",
    "read_codes",
    "read_depth",
    "read_evidence",
    "read_ids",
    "read_image",
    "read_json",
    "read_matrix",
    "read_mesh",
    "read_meshes",
    "read_normals",
    "read_observed_mesh",
    "read_picture",
    "read_ply",
    "read_points",
    "read_raster",
    "read_scan",
    "read_scene",
    "read_splats",
    "read_tensors",
    "read_versioned",
    "welded",
    "write_atomic",
    "write_bytes",
    "write_depth",
    "write_evidence",
    "write_glb",
    "write_ids",
    "write_image",
    "write_json",
    "write_mesh",
    "write_meshes",
    "write_normals",
    "write_ply",
    "write_png",
    "write_points",
    "write_scene",
    "write_splats",
    "write_tensors",
]
