"""Metashape's XML and RealityCapture's CSV, as their programs write them."""

import numpy as np
import pytest

from captures import LENS, poses, see
from goc.capture import CaptureConfig, load_capture
from goc.capture.readers.metashape import READER as METASHAPE
from goc.errors import CaptureError, FileError
from goc.files import write_png

SENSOR = """<sensor id="0" label="unknown" type="{kind}"><resolution width="64" height="48"/>
<calibration type="{kind}" class="initial"><f>1</f></calibration>
<calibration type="{kind}" class="adjusted"><resolution width="64" height="48"/><f>51</f><cx>-1</cx><cy>0.5</cy>
<b1>-1</b1>{more}</calibration></sensor>"""
CAMERA = '<camera id="{id}" sensor_id="0" component_id="0" label="{id:04d}">{transform}</camera>'


def write_metashape(folder, kind="frame", more="", component="", chunk="", lost=0):
    cameras = ""
    for number, pose in enumerate(poses(3)):
        write_png(folder / "photos" / f"{number:04d}.png", see(pose).image)
        numbers = " ".join(f"{value:.12f}" for value in pose.ravel())
        cameras += CAMERA.format(id=number, transform=f"<transform>{numbers}</transform>" if number >= lost else "")
    text = f"""<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="c" enabled="true">
<sensors next_id="1">{SENSOR.format(kind=kind, more=more)}</sensors>
<components next_id="1"><component id="0">{component}</component></components>
<cameras next_id="3"><group id="0">{cameras}</group></cameras>{chunk}</chunk></document>"""
    (folder / "doc.xml").write_text(text)
    return folder


def test_metashape_gives_poses_lens_and_names(tmp_path):
    capture = load_capture(write_metashape(tmp_path))
    assert capture.view_names == ("photos/0000.png", "photos/0001.png", "photos/0002.png")
    for camera, pose in zip(capture.cameras, poses(3), strict=True):
        np.testing.assert_allclose(camera.world_from_cam.numpy(), pose, atol=1e-6)
        np.testing.assert_allclose(camera.focal_px.numpy(), [50.0, 51.0])  # fx = f + b1
        np.testing.assert_allclose(camera.centre_px.numpy(), LENS.centre_px)
    assert not capture.metric
    assert len(load_capture(tmp_path / "doc.xml")) == 3


def test_metashape_scales_where_it_was_measured(tmp_path):
    turn = "<rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>1 2 3</translation><scale>2</scale>"
    capture = load_capture(write_metashape(tmp_path, component=f"<transform>{turn}</transform>"))
    assert capture.metric
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    pose = poses(3)[1]
    found = capture.cameras[1].world_from_cam.numpy()
    np.testing.assert_allclose(found[:3, :3], quarter @ pose[:3, :3], atol=1e-6)
    np.testing.assert_allclose(found[:3, 3], 2 * quarter @ pose[:3, 3] + [1, 2, 3], atol=1e-6)


def test_metashapes_p1_is_opencvs_p2(tmp_path):
    source = METASHAPE.read(
        write_metashape(tmp_path, more="<k1>.1</k1><p1>.01</p1><p2>.02</p2>"), CaptureConfig(), print
    )
    assert source.views[0].lens.tangential == (0.02, 0.01)
    assert source.views[0].lens.radial == (0.1, 0, 0, 0)
    source = METASHAPE.read(write_metashape(tmp_path, kind="fisheye"), CaptureConfig(), print)
    assert source.views[0].lens.projection == "fisheye"


def test_cameras_that_are_not_aligned_are_left_out_and_counted(tmp_path):
    heard = []
    assert len(load_capture(write_metashape(tmp_path, lost=1), notify=heard.append)) == 2
    assert heard[0].message == "1 of 3 cameras are not aligned and left out (first: 0000)"
    with pytest.raises(CaptureError, match="none of 3 cameras is aligned"):
        load_capture(write_metashape(tmp_path, lost=3))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"more": "<b2>9</b2>"}, r"sensor 0 has skew \(b2 = 9 px\)"),
        ({"more": "<k1>x</k1>"}, r"<k1> does not hold 1 numbers"),
        ({"component": "<transform><scale>-1</scale></transform>"}, "a <scale> is -1"),
        ({"chunk": "</broken>"}, "not readable XML"),
        ({"chunk": "</chunk><chunk>"}, "holds 2 chunks, expected 1"),
    ],
)
def test_malformed_xml_is_one_error(tmp_path, settings, message):
    with pytest.raises((CaptureError, FileError), match=message) as caught:
        load_capture(write_metashape(tmp_path, **settings))
    assert "\n" not in str(caught.value)


HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"


def write_csv(folder, *rows, header=HEADER):
    write_png(folder / "images" / "a.png", np.zeros((48, 64, 3), np.uint8))
    (folder / "reg.csv").write_text("\n".join([header, *rows]) + "\n")
    return folder


@pytest.mark.parametrize(
    ("angles", "forward", "down"),
    [
        ("0,0,0", (0, 0, -1), (0, -1, 0)),  # straight down, north above
        ("0,90,0", (0, 1, 0), (0, 0, -1)),  # level, to the north
        ("90,90,0", (1, 0, 0), (0, 0, -1)),  # level, to the east
        ("0,60,0", (0, np.sin(np.pi / 3), -0.5), (0, -0.5, -np.sin(np.pi / 3))),
    ],
)
def test_realitycaptures_angles_look_where_they_say(tmp_path, angles, forward, down):
    write_csv(tmp_path, f"a.png,1,2,3,{angles},36,0.1,-0.05,0,0,0,0,0,0")
    capture = load_capture(tmp_path, CaptureConfig(checks="off"))
    pose = capture.cameras[0].world_from_cam.numpy()
    np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-6)
    np.testing.assert_allclose(pose[:3, 1], down, atol=1e-6)
    np.testing.assert_allclose(pose[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(capture.cameras[0].focal_px.numpy(), [64, 64])  # 36 mm on 36 mm of film
    np.testing.assert_allclose(capture.cameras[0].centre_px.numpy(), [32 + 6.4, 24 - 3.2], rtol=1e-6)


def test_malformed_csv_is_one_error(tmp_path):
    row = "a.png,1,2,3,0,90,0,36,0,0,0,0,0,0,0,0"
    with pytest.raises(FileError, match="has no column roll, f"):
        load_capture(write_csv(tmp_path, row, header="#name,x,y,alt,heading,pitch,what,who,px,py"))
    with pytest.raises(FileError, match="line 3 lacks numbers"):
        load_capture(write_csv(tmp_path, row, "a.png,1,2"))
    with pytest.raises(FileError, match="line 2 holds numbers that are not finite"):
        load_capture(write_csv(tmp_path, row.replace("36", "nan")))
    with pytest.raises(CaptureError, match=r"1 of 2 photographs are missing \(first: b\.png\)"):
        load_capture(write_csv(tmp_path, row, row.replace("a.png", "b.png")))
    (tmp_path / "two.csv").write_text(HEADER)
    with pytest.raises(CaptureError, match=r"2 camera files \(reg\.csv, two\.csv\)\. Give the one to read"):
        load_capture(tmp_path)
