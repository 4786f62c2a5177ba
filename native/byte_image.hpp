// SPDX-License-Identifier: Apache-2.0
// Images of 8 bit as Python gives them.
#pragma once

#include <nanobind/ndarray.h>

#include <cstdint>
#include <optional>
#include <stdexcept>

#include "edges.hpp"

namespace grasptrack {

using ByteImage = nanobind::ndarray<const std::uint8_t, nanobind::shape<-1, -1>, nanobind::c_contig, nanobind::device::cpu>;

inline Image<std::uint8_t> seen(const ByteImage &image) {
    return {image.data(), static_cast<std::ptrdiff_t>(image.shape(0)), static_cast<std::ptrdiff_t>(image.shape(1))};
}

// The distances to what is hidden, of the image's size; no data where nothing is hidden.
inline Image<std::uint8_t> clear_of(const ByteImage &image, const std::optional<ByteImage> &clear) {
    if (!clear) return {nullptr, 0, 0};
    if (clear->shape(0) != image.shape(0) || clear->shape(1) != image.shape(1))
        throw std::invalid_argument("what is hidden needs the image's size");
    return seen(*clear);
}

}  // namespace grasptrack
