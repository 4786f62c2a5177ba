# SPDX-License-Identifier: Apache-2.0
"""Every step of the product, over the outline's length and over the image's size, with OpenCV's calls beside it."""

from __future__ import annotations

import common

# isort: split
import steps_contour
import steps_image


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument(
        "--calls", type=int, default=1000, help="calls of each step on 300 points; fewer on long outlines"
    )
    parser.add_argument(
        "--updates", type=int, default=120, help="images of each step at 640x480; fewer at larger sizes"
    )
    parser.add_argument("--only", choices=("outline", "image"), help="one half of it")
    args = parser.parse_args()
    if args.only != "image":
        steps_contour.run(args.calls)
    if args.only != "outline":
        steps_image.run(args.updates)
    common.finish(args.output)


if __name__ == "__main__":
    main()
