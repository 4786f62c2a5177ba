// SPDX-License-Identifier: Apache-2.0
// Threshold of a softened window.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace grasptrack {

// Columns left..left + columns of a row, softened by (1 2 1) along it. Everything by value and restricted: a byte that is
// written might otherwise be the loop's own bound, and the compiler leaves its vector unit unused.
inline void soften_row(const std::uint8_t *__restrict row, std::int64_t width, std::int64_t left, std::int64_t columns,
                       std::uint16_t *__restrict sum) {
    const std::int64_t first = left > 0 ? 0 : 1, last = left + columns < width ? columns : columns - 1;
    const std::uint8_t *__restrict here = row + left;
    if (first == 1) sum[0] = static_cast<std::uint16_t>(3 * here[0] + (width > 1 ? here[1] : here[0]));
    for (std::int64_t x = first; x < last; ++x)
        sum[x] = static_cast<std::uint16_t>(here[x - 1] + 2 * here[x] + here[x + 1]);
    if (last < columns && columns - 1 >= first)
        sum[columns - 1] = static_cast<std::uint16_t>(row[width > 1 ? width - 2 : 0] + 3 * row[width - 1]);
}

inline void threshold_row(const std::uint16_t *__restrict above, const std::uint16_t *__restrict here,
                          const std::uint16_t *__restrict below, std::int64_t columns, std::uint16_t limit,
                          std::uint8_t flip, std::uint8_t *__restrict out) {
    for (std::int64_t x = 0; x < columns; ++x) {
        const auto sum = static_cast<std::uint16_t>(above[x] + 2 * here[x] + below[x]);
        out[x] = static_cast<std::uint8_t>((sum <= limit ? 255 : 0) ^ flip);
    }
}

inline void blur_threshold(const std::uint8_t *image, std::int64_t height, std::int64_t width, std::int64_t left,
                           std::int64_t top, std::int64_t right, std::int64_t bottom, double level, int polarity,
                           std::uint8_t *out) {
    const std::int64_t columns = right - left;
    const std::uint8_t flip = polarity > 0 ? 0 : 255;
    // 16 times the softened grey level, compared in whole numbers of 16 bits: sums go up to 4080
    const int floored = static_cast<int>(std::floor(16.0 * std::clamp(level, -1.0, 256.0)));
    if (floored < 0) {
        std::fill(out, out + columns * (bottom - top), flip);
        return;
    }
    std::vector<std::uint16_t> rows(3 * columns);
    auto slot = [&](std::int64_t y) { return rows.data() + ((y + 3) % 3) * columns; };
    auto soften = [&](std::int64_t y) {
        soften_row(image + std::clamp<std::int64_t>(y, 0, height - 1) * width, width, left, columns, slot(y));
    };
    soften(top - 1);
    soften(top);
    for (std::int64_t y = top; y < bottom; ++y, out += columns) {
        soften(y + 1);
        threshold_row(slot(y - 1), slot(y), slot(y + 1), columns, static_cast<std::uint16_t>(floored), flip, out);
    }
}

}  // namespace grasptrack
