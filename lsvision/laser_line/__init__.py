"""Extraction of a laser line from a camera image to a fraction of a pixel.

In the order of the data flow: `image_array` checks an image, `line_image` reduces it to the laser's
channel (a raw colour image to the laser's pixels), `candidates` finds ridges in each column,
`path_search` connects them to a line, `detection` decides whether it is a laser line, `subpixel`
and `gaussian_fit` locate it in windows around it (`stripe_windows`), `pixel_sampling` corrects what
pixels do to a thin line and `ridge_smoothing` what Steger's method does to a curved one, `noise`
and, in JPEG images, `jpeg_blocks` estimate its standard deviation. `coarse_colours` chooses between
colour and luminance. `extraction` calls them all as `settings` state, and returns a `line`.
`line_blur`, with `line_shape` and `line_spread`, corrects an extracted line for the blur of the
lens.
"""
