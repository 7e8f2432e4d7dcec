"""Grey images of 8 bit from images of 16 bit."""

import numpy as np

from lsvision.laser_line.image_array import convert_to_grey


def test_the_largest_value_of_16_bit_becomes_255_and_0_stays():
    for largest in (1, 25, 29, 255, 1023, 4095, 58_321, 65_535):
        image = np.zeros((16, 16), dtype=np.uint16)
        image[3, 5] = largest
        grey = convert_to_grey(image)
        assert (grey[3, 5], grey.min()) == (255, 0), largest
