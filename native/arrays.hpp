// SPDX-License-Identifier: Apache-2.0
// NumPy arrays in and out.
#pragma once

#include "geometry.hpp"
#include "numpy.hpp"

namespace grasptrack {

using PointArray = Input<double, 2, 2>;
using RowArray = Input<double, 2>;
using ValueArray = Input<double, 1>;
using IndexArray = Input<std::int64_t, 1>;
using FlagArray = Input<bool, 1>;

inline const Vec *vectors(const PointArray &array) {
    static_assert(sizeof(Vec) == 2 * sizeof(double));
    return reinterpret_cast<const Vec *>(array.data());
}

inline Points points_of(const PointArray &array) { return {vectors(array), array.shape(0)}; }

inline Points contour_of(const PointArray &array) {
    if (array.shape(0) == 0) throw std::invalid_argument("a contour needs points");
    return points_of(array);
}

inline Outline outline_of(const PointArray &points, const IndexArray &offsets) {
    const std::int64_t *o = offsets.data();
    const std::size_t entries = offsets.shape(0);
    bool good = entries >= 2 && points.shape(0) > 0 && o[0] == 0 &&
                o[entries - 1] == static_cast<std::int64_t>(points.shape(0));
    for (std::size_t c = 1; good && c < entries; ++c) good = o[c - 1] < o[c];
    if (!good) throw std::invalid_argument("offsets must rise from 0 to the number of points");
    return {points_of(points), o, entries - 1};
}

inline Place place_of(const Outline &outline, const RowArray &places, std::size_t row) {
    const double *where = places.data() + row * places.shape(1);
    return find_place(outline, where[0], where[1]);
}

inline std::size_t count_places(const RowArray &places) {
    if (places.shape(1) < 2) throw std::invalid_argument("a place is a contour and a position");
    return places.shape(0);
}

class Output : public OutputOf<double> {
  public:
    using OutputOf::OutputOf;
    Vec *vectors() { return reinterpret_cast<Vec *>(values()); }
};

}  // namespace grasptrack
