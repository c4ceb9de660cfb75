"""Degrades exact captures by models of real sensors: noise of depth, images, poses and masks."""

from goc.synth.sensor.degrade import degrade_capture
from goc.synth.sensor.depth import Lidar, StructuredLight, lidar_depth, structured_light_depth
from goc.synth.sensor.images import ImageFaults, expose, motion_blur
from goc.synth.sensor.masks import corrupt_masks
from goc.synth.sensor.models import MODELS, Faults, SensorConfig
from goc.synth.sensor.monocular import MonocularDepth, StoredDepth, monocular_depth, monocular_normals
from goc.synth.sensor.poses import PoseFaults, perturb_pose

__all__ = [
    "MODELS",
    "Faults",
    "ImageFaults",
    "Lidar",
    "MonocularDepth",
    "PoseFaults",
    "SensorConfig",
    "StoredDepth",
    "StructuredLight",
    "corrupt_masks",
    "degrade_capture",
    "expose",
    "lidar_depth",
    "monocular_depth",
    "monocular_normals",
    "motion_blur",
    "perturb_pose",
    "structured_light_depth",
]
