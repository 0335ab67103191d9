"""Grey pixels of every encoding a camera driver may send."""

from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import CompressedImage, Image

from sandbot_common import messages
from sandbot_common.errors import InputError
from sandbot_tracking.pixels import ENCODINGS, grey

SIZES = st.tuples(st.integers(2, 12), st.integers(2, 12), st.integers(0, 5), st.integers(0, 2**32 - 1))
"""Height, width, padding of a row [B], seed."""
ORDER = {"bgr8": "bgr", "8UC3": "bgr", "rgb8": "rgb", "bgra8": "bgra", "rgba8": "rgba"}


def message(encoding, pixels, padding=0, big=False):
    """An Image whose rows end with ``padding`` bytes of rubbish."""
    rows = pixels.reshape(len(pixels), -1)
    rows = np.ascontiguousarray(rows.astype(">u2" if big else "<u2") if rows.dtype == np.uint16 else rows).view(
        np.uint8
    )
    rows = np.hstack([rows, np.full((len(rows), padding), 255, np.uint8)])
    image = Image(
        height=len(pixels), width=pixels.shape[1], encoding=encoding, step=rows.shape[1], is_bigendian=int(big)
    )
    image.data.frombytes(rows.tobytes())
    return image


def noise(shape, seed, kind=np.uint8):
    return np.random.default_rng(seed).integers(0, np.iinfo(kind).max + 1, shape, dtype=kind)


@given(SIZES)
def test_mono8_is_what_was_sent(size):
    height, width, padding, seed = size
    pixels = noise((height, width), seed)
    np.testing.assert_array_equal(grey(message("mono8", pixels, padding)), pixels)
    np.testing.assert_array_equal(grey(messages.image(0, "dorsal", pixels)), pixels)


@given(SIZES, st.booleans(), st.sampled_from([10, 12, 16]))
def test_sixteen_bits_become_the_upper_eight_in_either_byte_order(size, big, bits):
    height, width, padding, seed = size
    pixels = noise((height, width), seed, np.uint16) >> (16 - bits)
    np.testing.assert_array_equal(grey(message("mono16", pixels, 2 * padding, big), bits), pixels >> (bits - 8))
    assert (grey(message("mono16", np.full((2, 2), 5000, np.uint16)), 12) == 255).all()


@given(SIZES, st.sampled_from(sorted(ORDER)))
def test_colour_is_weighed_the_same_in_every_order(size, encoding):
    height, width, padding, seed = size
    bgr = noise((height, width, 3), seed)
    planes = {"b": bgr[..., 0], "g": bgr[..., 1], "r": bgr[..., 2], "a": noise((height, width), seed + 1)}
    pixels = np.stack([planes[letter] for letter in ORDER[encoding]], axis=-1)
    np.testing.assert_array_equal(grey(message(encoding, pixels, padding)), cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))


@given(SIZES, st.sampled_from(sorted(ORDER)))
def test_grey_sent_as_colour_stays_the_same_grey(size, encoding):
    height, width, padding, seed = size
    pixels = noise((height, width), seed)
    sent = np.repeat(pixels[..., None], len(ORDER[encoding]), axis=-1)
    np.testing.assert_array_equal(grey(message(encoding, sent, padding)), pixels)


@given(SIZES, st.sampled_from(["yuv422", "uyvy", "yuv422_yuy2", "yuyv"]))
def test_of_yuv_the_luma_is_taken(size, encoding):
    height, width, padding, seed = size
    luma, colour = noise((height, width), seed), noise((height, width), seed + 1)
    pair = (colour, luma) if encoding in ("yuv422", "uyvy") else (luma, colour)
    np.testing.assert_array_equal(grey(message(encoding, np.stack(pair, axis=-1), padding)), luma)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_of_one_colour_is_the_grey_of_that_colour(pattern, depth):
    colour = {"r": 200, "g": 100, "b": 40}
    cell = np.array([colour[letter] for letter in pattern], np.uint16).reshape(2, 2)
    mosaic = np.tile(cell, (4, 4))
    sent = mosaic.astype(np.uint8) if depth == 8 else mosaic << 8
    want = cv2.cvtColor(np.array([[[40, 100, 200]]], np.uint8), cv2.COLOR_BGR2GRAY)[0, 0]
    got = grey(message(f"bayer_{pattern}{depth}", sent))[2:-2, 2:-2].astype(int)
    assert np.abs(got - int(want)).max() <= 1
    other = {"rggb": "bggr", "bggr": "rggb", "gbrg": "grbg", "grbg": "gbrg"}[pattern]
    assert np.abs(grey(message(f"bayer_{other}{depth}", sent))[2:-2, 2:-2].astype(int) - int(want)).min() > 10


@pytest.mark.parametrize(("suffix", "off"), [(".png", 0), (".jpg", 6)])
def test_compressed_images_are_pictures(suffix, off):
    pixels = np.tile(np.arange(0, 240, 4, dtype=np.uint8), (40, 1))
    image = CompressedImage(format=f"mono8; {suffix[1:]} compressed mono8")
    image.data.frombytes(cv2.imencode(suffix, pixels)[1].tobytes())
    assert np.abs(grey(image).astype(int) - pixels).max() <= off
    colour = CompressedImage(format="bgr8; png compressed bgr8")
    colour.data.frombytes(cv2.imencode(".png", np.repeat(pixels[..., None], 3, axis=-1))[1].tobytes())
    np.testing.assert_array_equal(grey(colour), pixels)


def compressed(encoding, pixels, suffix=".png"):
    """What image_transport makes of an image."""
    image = CompressedImage(format=f"{encoding}; {suffix[1:]} compressed")
    image.data.frombytes(cv2.imencode(suffix, pixels)[1].tobytes())
    return image


@given(
    SIZES, st.sampled_from(["mono8", "mono16", "bgr8", "bayer_rggb8", "bayer_gbrg16"]), st.sampled_from([8, 10, 12, 16])
)
def test_a_png_is_as_grey_as_the_same_image_sent_raw(size, encoding, bits):
    height, width, _, seed = size
    kind = np.uint16 if encoding.endswith("16") else np.uint8
    # More than a mosaic's cell; a sensor that fills 12 bits of a message's 16.
    shape = (height + 2, width + 2) + ((3,) if encoding == "bgr8" else ())
    pixels = noise(shape, seed, kind) >> (16 - bits if kind is np.uint16 else 0)
    np.testing.assert_array_equal(grey(compressed(encoding, pixels), bits), grey(message(encoding, pixels), bits))
    if encoding == "mono16":
        np.testing.assert_array_equal(grey(compressed(encoding, pixels), bits), pixels >> (bits - 8))
        white = np.full((2, 2), 5000, np.uint16)
        assert (grey(compressed(encoding, white), 12) == 255).all()


def test_colours_made_of_a_mosaic_are_no_mosaic_and_sixteen_bits_have_colours_too():
    bgr = np.tile(np.array([40, 100, 200], np.uint8), (6, 8, 1))
    want = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(grey(compressed("bayer_rggb8", bgr)), want)
    np.testing.assert_array_equal(grey(compressed("rgb16", bgr.astype(np.uint16) << 4), 12), want)
    # One channel of that format is a mosaic.
    cells = np.tile(np.array([[200, 100], [100, 40]], np.uint8), (3, 4))
    assert (grey(compressed("bayer_rggb8", cells)) != grey(compressed("mono8", cells))).any()
    with pytest.raises(InputError, match="are not a picture"):
        grey(compressed("32FC1", np.ones((2, 2), np.float32), ".tiff"))


def test_what_cannot_be_read_is_refused_in_one_line():
    pixels = np.zeros((4, 6), np.uint8)
    with pytest.raises(InputError, match=r"'32FC1' can't be read; known: mono8"):
        grey(message("32FC1", pixels))
    short = message("bgr8", np.zeros((4, 6, 3), np.uint8))
    short.step = 17
    with pytest.raises(InputError, match=r"bgr8 image of 6x4 with rows of 17 bytes, 72 in all: at least 4 rows of 18"):
        grey(short)
    torn = message("mono8", pixels)
    torn.data = torn.data[:-1]
    with pytest.raises(InputError, match="23 in all"):
        grey(torn)
    with pytest.raises(InputError, match="0x0"):
        grey(Image(encoding="mono8"))
    with pytest.raises(InputError, match="5 bytes are not a picture"):
        grey(CompressedImage(format="jpeg", data=[1, 2, 3, 4, 5]))


@given(
    st.sampled_from([*ENCODINGS, "jpeg2000"]), st.integers(0, 9), st.integers(0, 9), st.integers(0, 40),
    st.binary(max_size=400),
)  # fmt: skip
def test_no_message_does_more_than_be_refused(encoding, height, width, step, data):
    image = Image(height=height, width=width, step=step, encoding=encoding)
    image.data.frombytes(data)
    with suppress(InputError):
        assert grey(image).shape == (height, width)
