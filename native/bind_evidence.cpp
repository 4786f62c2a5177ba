// SPDX-License-Identifier: Apache-2.0
// The kernels of the evidence for a pose and against it, in Python.

#include "bind_evidence.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>

#include "arrays.hpp"
#include "weighing.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using ByteImage = nb::ndarray<const std::uint8_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

nb::tuple py_weigh_edges(const ByteImage &image, const PointArray &points, const PointArray &normals,
                         const RowArray &edges, const FlagArray &inside, const FlagArray &found,
                         const ValueArray &reference_inside, const ValueArray &reference_outside, std::int64_t contacts,
                         int polarity, double reach, double size, const FlagArray &beside, const FlagArray &known,
                         const std::optional<ByteImage> &hidden) {
    const std::size_t m = points.shape(0), n = beside.shape(0);
    if (n == 0 || n > m || contacts < 1 || (m - n) % static_cast<std::size_t>(contacts) != 0 || known.shape(0) != n)
        throw std::invalid_argument("samples round the outline are needed, and as many under each contact");
    if (normals.shape(0) != m || edges.shape(0) != m || edges.shape(1) != 4 || inside.shape(0) != m ||
        found.shape(0) != m || reference_inside.shape(0) != m || reference_outside.shape(0) != m)
        throw std::invalid_argument("each sample needs its normal, edge, flags and levels");
    if (hidden && (hidden->shape(0) != image.shape(0) || hidden->shape(1) != image.shape(1)))
        throw std::invalid_argument("what is hidden needs the image's size");
    static_assert(sizeof(Edge) == 4 * sizeof(double));
    const Levels levels({image.data(), static_cast<std::ptrdiff_t>(image.shape(0)),
                         static_cast<std::ptrdiff_t>(image.shape(1))},
                        hidden ? hidden->data() : nullptr);
    const auto k = static_cast<std::size_t>(contacts);
    Output seen(k);
    OutputOf<bool> against(n);
    const Weights out = weigh_edges({vectors(points), vectors(normals), reinterpret_cast<const Edge *>(edges.data()),
                                     inside.data(), found.data(), reference_inside.data(), reference_outside.data(), m,
                                     n, polarity, reach, size},
                                    levels, beside.data(), known.data(), k, seen.values(), against.values());
    return nb::make_tuple(out.share, out.visible, out.rms, out.spread, seen.array(), out.against,
                          nb::make_tuple(out.dark, out.light), against.array());
}

}  // namespace

void bind_evidence(nb::module_ &m) {
    m.def("weigh_edges", &py_weigh_edges, "image"_a.noconvert(), "points"_a, "normals"_a, "edges"_a, "inside"_a,
          "found"_a, "reference_inside"_a, "reference_outside"_a, "contacts"_a, "polarity"_a, "reach"_a, "size"_a,
          "beside"_a, "known"_a, "hidden"_a.none());
}

}  // namespace grasptrack
