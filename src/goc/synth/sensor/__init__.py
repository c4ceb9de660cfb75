"""Makes perfect captures imperfect, each effect by a stated law: depth sensors, images, poses, masks."""

from goc.synth.sensor.degrade import degrade_capture
from goc.synth.sensor.depth import Lidar, StructuredLight, lidar_depth, structured_light_depth
from goc.synth.sensor.images import ImageFaults, expose, motion_blur
from goc.synth.sensor.masks import corrupt_masks
from goc.synth.sensor.models import MODELS, SensorConfig
from goc.synth.sensor.monocular import Monocular, Stored, monocular_depth, monocular_normals
from goc.synth.sensor.poses import PoseFaults, shake

__all__ = [
    "MODELS",
    "ImageFaults",
    "Lidar",
    "Monocular",
    "PoseFaults",
    "SensorConfig",
    "Stored",
    "StructuredLight",
    "corrupt_masks",
    "degrade_capture",
    "expose",
    "lidar_depth",
    "monocular_depth",
    "monocular_normals",
    "motion_blur",
    "shake",
    "structured_light_depth",
]
