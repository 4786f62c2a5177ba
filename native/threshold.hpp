// SPDX-License-Identifier: Apache-2.0
// Threshold of a softened window. Defined in kernels/reference_threshold.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace grasptrack {

inline void soft_threshold(const std::uint8_t *image, std::int64_t height, std::int64_t width, std::int64_t left,
                           std::int64_t top, std::int64_t right, std::int64_t bottom, double level, int polarity,
                           std::uint8_t *out) {
    const std::int64_t columns = right - left;
    // 16 times the softened grey level, compared in whole numbers
    const int floored = static_cast<int>(std::floor(16.0 * std::clamp(level, -1.0, 256.0)));
    if (floored < 0) {
        std::fill(out, out + columns * (bottom - top), static_cast<std::uint8_t>(polarity > 0 ? 0 : 255));
        return;
    }
    const auto limit = static_cast<std::uint16_t>(floored);  // of sums up to 4080: 16 bits all through, for the vector unit
    const std::uint8_t dark = polarity > 0 ? 255 : 0;
    std::vector<std::uint16_t> across(3 * columns);
    auto blur_row = [&](std::int64_t y) {
        const std::uint8_t *row = image + std::clamp<std::int64_t>(y, 0, height - 1) * width;
        std::uint16_t *sum = across.data() + ((y + 3) % 3) * columns;
        for (std::int64_t x = 0; x < columns; ++x) sum[x] = static_cast<std::uint16_t>(2 * row[left + x]);
        for (std::int64_t x = left > 0 ? 0 : 1; x < columns; ++x) sum[x] += row[left + x - 1];
        if (left == 0) sum[0] += row[0];
        const std::int64_t last = right < width ? columns : columns - 1;
        for (std::int64_t x = 0; x < last; ++x) sum[x] += row[left + x + 1];
        if (right == width) sum[columns - 1] += row[width - 1];
    };
    blur_row(top - 1);
    blur_row(top);
    for (std::int64_t y = top; y < bottom; ++y, out += columns) {
        blur_row(y + 1);
        const std::uint16_t *a = across.data() + ((y + 2) % 3) * columns;
        const std::uint16_t *b = across.data() + ((y + 3) % 3) * columns;
        const std::uint16_t *c = across.data() + ((y + 4) % 3) * columns;
        for (std::int64_t x = 0; x < columns; ++x) {
            const auto sum = static_cast<std::uint16_t>(a[x] + 2 * b[x] + c[x]);
            out[x] = static_cast<std::uint8_t>(sum <= limit ? dark : ~dark);
        }
    }
}

}  // namespace grasptrack
