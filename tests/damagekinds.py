"""A hundred kinds of damage, and what is said of each."""
# ruff: noqa: E501  # a table is read better with one kind a line

import numpy as np

from damage import (
    FLIP,
    Kind,
    both,
    cut,
    depths,
    distances,
    edit,
    frames,
    ids,
    images,
    keys,
    moved,
    one,
    pairs_as_text,
    poses,
)

NAN, INF = float("nan"), float("inf")
ROS_FROM_OPENCV = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_TURN = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def _translation_of_inverse(stack):
    out = stack.copy()
    out[:, :3, 3] = np.linalg.inv(stack)[:, :3, 3]
    return out


def _rotation_transposed(stack):
    out = stack.copy()
    out[:, :3, :3] = np.swapaxes(stack[:, :3, :3], 1, 2)
    return out


def _set(row, column, value):
    def change(stack):
        out = stack.copy()
        out[3, row, column] = value
        return out

    return poses(change)


def _stray(stack):
    out = stack.copy()
    out[3, :3, 3] += 900.0
    return out


def _held(stack):
    out = stack.copy()
    out[4:9] = stack[4]
    return out


def _drop(key):
    def change(document):
        for frame in document["frames"]:
            frame.pop(key)

    return edit(change)


def _own(key, value):
    """A key of all frames."""

    def change(document):
        for frame in document["frames"]:
            frame[key] = value

    return edit(change)


def _other_names(folder):
    for path in sorted((folder / "instance").iterdir()):
        path.rename(path.with_name(f"segmentation_{path.stem}_final_b.png"))
    _drop("instance_file_path")(folder)


def _mirrored(stack):
    out = stack.copy()
    out[:, 0, 3] *= -1
    return out


FILES = [
    Kind(
        "image missing", one("images/0003.png", None), r"1 of 12 images are missing \(first: images/0003\.png\)\. Add"
    ),
    Kind("depth missing", one("depth/0003.png", None), r"1 of 12 depth images are missing .* Add them, or pass"),
    Kind("ids missing", one("instance/0003.png", None), r"1 of 12 id images are missing .* Add them, or pass"),
    Kind("image cut", cut("images/0007.png"), r"images/0007\.png: damaged or cut short .* Copy or write it again"),
    Kind("depth cut", cut("depth/0007.png"), r"depth/0007\.png: damaged or cut short .* Copy or write it again"),
    Kind("ids cut", cut("instance/0007.png"), r"instance/0007\.png: damaged or cut short"),
    Kind("image empty", one("images/0003.png", b""), r"images/0003\.png: not a readable"),
    Kind("image is text", one("images/0003.png", b"no picture"), r"images/0003\.png: not a readable"),
    Kind("depth is text", one("depth/0003.png", b"no picture"), r"depth/0003\.png: not a readable"),
    Kind("json empty", one("transforms.json", b""), r"transforms\.json: "),
    Kind("json no json", one("transforms.json", b"frames: 3"), r"transforms\.json: "),
    Kind("json cut", cut("transforms.json"), r"transforms\.json: "),
    Kind("json a list", one("transforms.json", b"[1, 2]"), r"transforms\.json: Expected `object`"),
    Kind("json binary", one("transforms.json", bytes(range(256))), r"transforms\.json: "),
    Kind("no frames", keys(frames=[]), r"lists no views\. Check that the capture is complete"),
    Kind("frames absent", keys(frames=None), r"missing required field `frames`"),
    Kind("frames an object", keys(frames={"a": 1}), r"Expected `array`"),
    Kind("frame without file", edit(lambda d: d["frames"][2].pop("file_path")), r"missing required field `file_path`"),
    Kind("name twice", frames(file_path="images/0002.png"), r"1 of 12 views name an image twice .* Keep one entry"),
    Kind("image outside", frames(file_path="/nowhere/0003.png"), r"1 of 12 images are missing \(first: /nowhere"),
    Kind("labels no ids", one("labels.json", b'{"sofa": "3"}'), r"labels\.json: 1 of 1 names belong to no id"),
    Kind("labels no json", one("labels.json", b"sofa"), r"labels\.json: "),
    Kind("points missing", one("points.ply", None), r"points\.ply"),
    Kind("points cut", cut("points.ply"), r"points\.ply: "),
    Kind("points text", one("points.ply", b"ply? no"), r"points\.ply: "),
    Kind("masks of other names", _other_names, r"instance/ holds 12 images that no view uses .* Name them as"),
    Kind(
        "depth not named",
        _drop("depth_file_path"),
        r"depth/ holds 12 images that no view uses .* name them in the capture's file",
        refused=False,
    ),
]

SIZES = [
    Kind(
        "image cropped",
        images("images", lambda i: i[:, 8:]),
        r"12 of 12 images are not of the size of their intrinsics",
    ),
    Kind("depth cropped", depths(lambda d: d[:, 8:]), r"another aspect ratio than the image"),
    Kind("ids cropped", ids(lambda i: i[8:]), r"another aspect ratio than the image"),
    Kind("depth on its side", depths(lambda d: np.rot90(d)), r"another aspect ratio than the image"),
    Kind("w and h swapped", keys(w=48, h=64), r"not of the size of their intrinsics"),
    Kind("w zero", keys(w=0), r"w and h are 0 and 48"),
    Kind("w a fraction", keys(w=64.5), r"w and h are 64\.5 and 48"),
    Kind("w negative", keys(w=-64), r"w and h are -64"),
]

INTRINSICS = [
    Kind("focal zero", keys(fl_x=0.0, fl_y=0.0), r"focal lengths are 0 and 0\. They must be positive"),
    Kind("focal negative", keys(fl_x=-50.0), r"focal lengths are -50"),
    Kind("focal absent", keys(fl_x=None, fl_y=None), r"no focal length\. Give fl_x"),
    Kind(
        "focal in millimetres", keys(fl_x=4.2, fl_y=4.2), r"12 of 12 views see 165 degrees across .* not in millimetres"
    ),
    Kind("focal a share", keys(fl_x=0.78, fl_y=0.8), r"views see 177 degrees across .* Give fx, fy in pixels"),
    Kind("focal of a large image", keys(fl_x=2000.0, fl_y=2040.0), r"views see 1\.83 degrees across"),
    Kind("focal of twice the size", keys(fl_x=100.0, fl_y=102.0), r"intrinsics look like those of another"),
    Kind("focal of half the size", keys(fl_x=25.0, fl_y=25.5), r"intrinsics look like those of another"),
    Kind("angle in degrees", keys(fl_x=None, fl_y=None, camera_angle_x=65.2), r"focal lengths are 0 and 0"),
    Kind(
        "principal point 0",
        keys(cx=0.0, cy=0.0),
        r"principal point is the image's corner in 12 of 12 .* leave them out",
    ),
    Kind("principal point a share", keys(cx=0.5, cy=0.5), r"principal point is the image's corner in 12 of 12"),
    Kind("principal point outside", keys(cx=640.0), r"principal point 640, 24\.5 is outside the image of 64 x 48"),
    Kind("principal point of half the size", keys(cx=15.5, cy=12.25), r"(principal point|intrinsics) looks? "),
    Kind("distortion absurd", keys(k1=-50.0), r"distortion .* leaves next to nothing|sees nothing"),
    Kind("model unknown", keys(camera_model="PANOMORPH"), r"camera model PANOMORPH is not"),
]

POSES = [
    Kind("pose nan", _set(0, 0, NAN), r"1 of 12 poses are not usable \(first: frames\[3\].*not finite|not valid JSON"),
    Kind("pose inf", _set(1, 3, INF), r"1 of 12 poses are not usable .*not finite|not valid JSON"),
    Kind("poses nan", poses(lambda p: p * NAN), r"12 of 12 poses are not usable|not valid JSON"),
    Kind("pose zero", poses(lambda p: p * 0), r"its last row is 0 0 0 0|axes, of lengths 0 0 0"),
    Kind("pose of text", frames(transform_matrix="none"), r"Expected `array`"),
    Kind("pose null", frames(transform_matrix=None), r"Expected `array`"),
    Kind("pose a list of 16", frames(transform_matrix=[1.0] * 16), r"Expected `array`"),
    Kind("pose 3 x 3", frames(transform_matrix=np.eye(3).tolist()), r"expected 4 x 4 numbers, found 3 rows of \[3\]"),
    Kind("poses mirrored", poses(lambda p: p @ np.diag([-1, 1, 1, 1.0])), r"it mirrors \(left-handed axes\)"),
    Kind("poses scaled", poses(lambda p: p @ np.diag([1.5, 1.5, 1.5, 1])), r"are not those of a rotation"),
    Kind("poses column-major", poses(lambda p: np.swapaxes(p, 1, 2)), r"its last row is .*, not 0 0 0 1"),
    Kind(
        "poses world-to-camera",
        poses(np.linalg.inv),
        r"poses look world-to-camera: .* Pass --capture\.convention\.poses world-to-camera\.",
    ),
    Kind(
        "poses OpenCV",
        poses(lambda p: p @ FLIP),
        r"poses look to have OpenCV axes: .* Pass --capture\.convention\.axes opencv\.",
    ),
    Kind("poses ROS", poses(lambda p: p @ FLIP @ ROS_FROM_OPENCV.T), r"poses look to have ROS axes"),
    Kind(
        "poses of OpenCV's extrinsics",
        poses(lambda p: np.linalg.inv(p @ FLIP)),
        r"poses look world-to-camera with OpenCV axes: .*poses world-to-camera --capture\.convention\.axes opencv",
    ),
    Kind(
        "poses of other axes",
        poses(lambda p: p @ np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])),
        r"axes look like x",
    ),
    Kind("poses on their side", poses(lambda p: p @ _TURN), r"images look turned by a quarter turn"),
    Kind("poses upside down", poses(lambda p: p @ _TURN @ _TURN), r"images look turned by half a turn"),
    Kind("translation of the inverse", poses(_translation_of_inverse), r"looks like the translation of the inverse"),
    Kind("rotation transposed", poses(_rotation_transposed), r"rotations of the poses look transposed"),
    Kind("positions mirrored", poses(_mirrored), r"positions look mirrored"),
    Kind("poses all one", poses(lambda p: np.repeat(p[:1], len(p), 0)), r"all 12 views have the same pose\. Write"),
    Kind(
        "poses all identity", poses(lambda p: np.repeat(np.eye(4)[None], len(p), 0)), r"all 12 views have the same pose"
    ),
    Kind(
        "poses one late", poses(lambda p: np.concatenate([p[:1], p[:-1]])), r"poses look paired|contradict each other"
    ),
    Kind("poses reversed", poses(lambda p: p[::-1]), r"poses look paired with the images in reverse"),
    Kind("poses sorted as text", pairs_as_text, r"poses look paired with the images in the order of their"),
    Kind(
        "poses shuffled",
        poses(lambda p: p[[3, 8, 1, 10, 5, 0, 11, 2, 9, 6, 4, 7]]),
        r"depth and poses contradict each other",
    ),
    Kind(
        "positions in millimetres",
        moved(1000.0),
        r"positions look 1[01]\d\d times|positions look 9\d\d times|convention",
    ),
    Kind(
        "positions of another scale",
        moved(0.37),
        r"positions look 0\.3\d+ times .* Pass --capture\.convention\.pose-unit 2\.\d",
    ),
    Kind("positions in feet", moved(3.281), r"positions look 3\.\d+ times"),
    Kind("a pose astray", poses(_stray), r"1 of 12 cameras stand", refused=False),
    Kind("poses held", poses(_held), r"depth and poses contradict each other"),
]


_EVERYTHING = (("millimetres", 1000.0), ("centimetres", 100.0))
DEPTH = [
    Kind("depth nothing", depths(lambda d: d * 0), r"depth images of all 12 views .* hold nothing but 0"),
    Kind(
        "depth in metres",
        keys(depth_unit_scale_factor=1.0),
        r"depth looks like millimetres: .* --capture\.convention\.depth-unit 0\.001",
    ),
    Kind("depth factor 0", keys(depth_unit_scale_factor=0.0), r"depth_unit_scale_factor is 0\. Give the metres"),
    Kind("depth factor negative", keys(depth_unit_scale_factor=-0.001), r"depth_unit_scale_factor is -0\.001"),
    Kind("depth factor text", keys(depth_unit_scale_factor="mm"), r"Expected `float"),
    Kind(
        "depth of TUM",
        depths(lambda d: d * 5),
        r"depth looks like millimetres x 5 .* --capture\.convention\.depth-unit 0\.0002",
    ),
    Kind(
        "depth of Replica",
        depths(lambda d: d * 6.5535),
        r"depth looks like 1/6553\.5 m \(Replica\): .*depth-unit 0\.00015259",
    ),
    Kind("depth in tenths", depths(lambda d: d * 10), r"depth looks like tenths of a millimetre"),
    Kind("depth in centimetres", depths(lambda d: d / 10), r"depth looks like centimetres"),
    Kind("depth shifted", depths(lambda d: d * 8), r"depth looks like millimetres x 8"),
    Kind("depth distance", distances, r"depth looks like the distance .* --capture\.depth-kind distance"),
    Kind(
        "depth disparity",
        depths(lambda d: 3e6 / np.maximum(d, 1)),
        r"depth looks like disparity .* --capture\.depth-kind inverse",
    ),
    Kind("depth flipped", depths(lambda d: d[:, ::-1]), r"depth images look flipped \(left and right\)"),
    Kind("depth upside down", depths(lambda d: d[::-1]), r"depth images look flipped \(upside down\)"),
    Kind("depth constant", depths(lambda d: d * 0 + 1500), r"nearly every pixel has the same depth, 1\.5"),
    Kind(
        "depth noise", depths(lambda d: np.random.default_rng(0).uniform(500, 5000, d.shape)), r"contradict each other"
    ),
    Kind("depth of 8 bits", images("depth", lambda d: (d / 16).astype(np.uint8)), r"depth looks like|positions look"),
    Kind(
        "depth filled",
        depths(lambda d: np.where(d > 2000, 10000, d)),
        r"depth of exactly 10000 looks like the mark of pixels without depth: .* Write 0 there",
    ),
    *(
        Kind(
            f"all in {unit}",
            both(keys(depth_unit_scale_factor=factor / 1000), moved(factor)),
            rf"everything looks to be in {unit}: .* Pass --capture\.units-per-metre {factor:g}",
        )
        for unit, factor in _EVERYTHING
    ),
    Kind("all tiny", both(keys(depth_unit_scale_factor=1e-6), moved(1e-3)), r"the unit looks wrong: things are 0\.00"),
    Kind(
        "mm and world-to-camera",
        both(keys(depth_unit_scale_factor=1.0), poses(np.linalg.inv)),
        r"world-to-camera, and depth looks like millimetres",
    ),
]

IDS = [
    Kind("ids nothing", ids(lambda i: i * 0), r"id images hold nothing but 0, the room .* Number objects from 1"),
    Kind("ids unlabelled", ids(lambda i: i * 0 + 255), r"hold nothing but 255"),
    Kind(
        "ids 0 and 255", ids(lambda i: ((i > 0) * 255).astype(np.uint8)), r"255 is taken for one object", refused=False
    ),
    Kind("ids beyond", ids(lambda i: i.astype(np.uint16) * 20000), r"holds id 40000, beyond 32767"),
    Kind("ids one thing", ids(lambda i: i * 0 + 3), r"one id covers every view", refused=False),
]

PHOTOGRAPHS = [
    Kind("images black", images("images", lambda i: i * 0), r"all 12 photographs .* are of one colour"),
    Kind(
        "images one",
        images("images", lambda i: (np.indices(i.shape).sum(0) % 251).astype(np.uint8)),
        r"11 of 12 photographs .* repeat another",
        refused=False,
    ),
]

KINDS = FILES + SIZES + INTRINSICS + POSES + DEPTH + IDS + PHOTOGRAPHS
