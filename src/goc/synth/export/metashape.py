"""Metashape's cameras.xml: a sensor and a component with a scale of its own."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from goc.files import write_bytes, write_json
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture, RoomView
from goc.synth.sensor.source import link

_SCALE = 2.5
"""Metres in the component's unit, as after marking a known length."""


def _write(room: RoomCapture, out: Path) -> None:
    document = ElementTree.Element("document", version="2.0.0")
    chunk = ElementTree.SubElement(document, "chunk", label="Chunk 1", enabled="true")
    sensors = ElementTree.SubElement(chunk, "sensors", next_id=str(len(room.views)))
    components = ElementTree.SubElement(chunk, "components", next_id="1", active_id="0")
    transform = ElementTree.SubElement(ElementTree.SubElement(components, "component", id="0"), "transform")
    ElementTree.SubElement(transform, "scale", locked="false").text = repr(_SCALE)
    cameras = ElementTree.SubElement(chunk, "cameras", next_id=str(len(room.views)))
    for number, view in enumerate(room.views):
        link(view.image_path, out / "images" / view.image_path.name)
        link(view.ids_path, out / "instance" / f"{view.name}.png")
        _add_sensor(sensors, number, view)
        pose = view.world_from_cam.copy()
        pose[:3, 3] /= _SCALE
        names = {"id": str(number), "sensor_id": str(number), "component_id": "0", "label": view.name}
        camera = ElementTree.SubElement(cameras, "camera", names)
        ElementTree.SubElement(camera, "transform").text = " ".join(f"{value:.17g}" for value in np.ravel(pose))
    lost = {"id": str(len(room.views)), "sensor_id": "0", "label": "not_aligned"}
    ElementTree.SubElement(cameras, "camera", lost)
    write_bytes(out / "cameras.xml", ElementTree.tostring(document, encoding="utf-8", xml_declaration=True))
    write_json(out / "labels.json", {str(key): name for key, name in room.names.items()})


def _add_sensor(sensors: ElementTree.Element, number: int, view: RoomView) -> None:
    sensor = ElementTree.SubElement(sensors, "sensor", id=str(number), label="room", type="frame")
    size = {"width": str(view.width), "height": str(view.height)}
    ElementTree.SubElement(sensor, "resolution", size)
    calibration = ElementTree.SubElement(sensor, "calibration", {"type": "frame", "class": "adjusted"})
    ElementTree.SubElement(calibration, "resolution", size)
    numbers = {
        "f": view.focal_px[1],
        "b1": view.focal_px[0] - view.focal_px[1],
        "cx": view.centre_px[0] - view.width / 2,
        "cy": view.centre_px[1] - view.height / 2,
    }
    for name, value in numbers.items():
        ElementTree.SubElement(calibration, name).text = f"{value:.17g}"


EXPORTER = Exporter(name="metashape", writes="cameras.xml, ids in instance/", write=_write, lacks=frozenset({"depth"}))
