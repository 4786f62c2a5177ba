// SPDX-License-Identifier: Apache-2.0
// The kernels of images and of the evidence in them, in Python.

#include "bind_images.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <optional>
#include <limits>
#include <vector>

#include "arrays.hpp"
#include "byte_image.hpp"
#include "edges.hpp"
#include "evidence.hpp"
#include "fusion.hpp"
#include "links.hpp"
#include "outline.hpp"
#include "register.hpp"
#include "registration.hpp"
#include "support.hpp"
#include "threshold.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using ChainArray = nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

template <typename Pixel>
nb::object py_edge_search(const nb::ndarray<const Pixel, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu> &image,
                          const PointArray &points, const PointArray &normals, double reach, int polarity) {
    if (!(reach > 0 && reach <= 1000))
        throw std::invalid_argument("reach must be above 0 and at most 1000 px, not " + number(reach));
    const Points at = points_of(points);
    if (normals.shape(0) != at.size)
        throw std::invalid_argument(std::to_string(at.size) + " points but " + std::to_string(normals.shape(0)) +
                                    " normals");
    static_assert(sizeof(Edge) == 4 * sizeof(double));
    Output out(at.size, 4);
    const Image<Pixel> seen{image.data(), static_cast<std::ptrdiff_t>(image.shape(0)),
                            static_cast<std::ptrdiff_t>(image.shape(1))};
    edge_search(seen, at, vectors(normals), reach, polarity, reinterpret_cast<Edge *>(out.values()));
    return out.array();
}

nb::object py_edge_links(const ByteImage &edges, double reach, double bend, double loose) {
    const auto links = edge_links(edges.data(), static_cast<std::int64_t>(edges.shape(0)),
                                  static_cast<std::int64_t>(edges.shape(1)), reach, bend, loose);
    OutputOf<std::int64_t> out(links.size(), 4);
    for (std::size_t i = 0; i < links.size(); ++i) std::copy(links[i].begin(), links[i].end(), out.values() + 4 * i);
    return out.array();
}

nb::tuple py_settle_edges(const PointArray &points, const PointArray &normals, const RowArray &edges,
                          const FlagArray &fixed, double fallback, double outlier) {
    const std::size_t n = points.shape(0);
    if (n < 5 || normals.shape(0) != n || edges.shape(0) != n || edges.shape(1) < 2 || fixed.shape(0) != n)
        throw std::invalid_argument("points, normals, edges and flags need the same length, at least 5");
    Output moved(n, 2), strength(n);
    settle_edges(points.data(), normals.data(), edges.data(), static_cast<std::int64_t>(edges.shape(1)), fixed.data(),
                 static_cast<std::int64_t>(n), fallback, outlier, moved.values(), strength.values());
    return nb::make_tuple(moved.array(), strength.array());
}

nb::object py_carry_normals(const RowArray &H, const PointArray &points, const PointArray &normals) {
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    if (normals.shape(0) != points.shape(0)) throw std::invalid_argument("each point needs its normal");
    Output out(points.shape(0), 5);
    carry_normals(H.data(), points.data(), normals.data(), static_cast<std::int64_t>(points.shape(0)), out.values());
    return out.array();
}

nb::tuple py_projective_step(const PointArray &points, const PointArray &normals, const ValueArray &offsets,
                             const PointArray &contacts, double radius, double loose) {
    const std::size_t m = points.shape(0), k = contacts.shape(0);
    if (normals.shape(0) != m || offsets.shape(0) != m)
        throw std::invalid_argument("each point needs its normal and its offset");
    if (k == 0 || !(radius > 0 && loose > 0)) throw std::invalid_argument("contacts, a radius and a looseness are needed");
    Output shift(k, 2), covariance(k, 4);
    projective_step(points.data(), normals.data(), offsets.data(), static_cast<std::int64_t>(m), contacts.data(),
                    static_cast<std::int64_t>(k), radius, loose, shift.values(), covariance.values());
    return nb::make_tuple(shift.array(), covariance.array().attr("reshape")(nb::make_tuple(k, 2, 2)));
}

nb::object py_soft_threshold(const ByteImage &image,
                             std::int64_t left, std::int64_t top, std::int64_t right, std::int64_t bottom, double level,
                             int polarity) {
    const auto height = static_cast<std::int64_t>(image.shape(0)), width = static_cast<std::int64_t>(image.shape(1));
    if (!(0 <= left && left < right && right <= width && 0 <= top && top < bottom && bottom <= height))
        throw std::invalid_argument("the window must lie in the image and hold a pixel");
    const std::size_t rows = static_cast<std::size_t>(bottom - top), columns = static_cast<std::size_t>(right - left);
    auto *data = new std::uint8_t[rows * columns];
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<std::uint8_t *>(p); });
    soft_threshold(image.data(), height, width, left, top, right, bottom, level, polarity, data);
    return nb::cast(nb::ndarray<nb::numpy, std::uint8_t, nb::ndim<2>>(data, {rows, columns}, owner));
}

// A new array of flags.
class Flags {
  public:
    explicit Flags(std::size_t size) : size_(size), data_(new bool[size]()) {}
    bool *values() { return data_; }
    nb::object array() {
        nb::capsule owner(data_, [](void *p) noexcept { delete[] static_cast<bool *>(p); });
        return nb::cast(nb::ndarray<nb::numpy, bool, nb::ndim<1>>(data_, {size_}, owner));
    }

  private:
    std::size_t size_;
    bool *data_;
};


nb::tuple py_trace_edges(const ByteImage &image, const ChainArray &chain, const std::optional<ByteImage> &hidden,
                         bool hole, int polarity, double spacing, int most, double smoothing, double reach,
                         double border, double outlier) {
    if (chain.shape(0) < 3) throw std::invalid_argument("a chain has at least 3 pixels");
    if (hidden && (hidden->shape(0) != image.shape(0) || hidden->shape(1) != image.shape(1)))
        throw std::invalid_argument("what is hidden needs the image's size");
    const Traced found = trace_edges(seen(image), chain.data(), chain.shape(0), hidden ? hidden->data() : nullptr,
                                     {spacing, static_cast<double>(most), smoothing, reach, border, outlier, hole, polarity});
    const std::size_t n = found.points.size();
    Output points(n, 2), strength(n);
    std::copy(found.points.begin(), found.points.end(), points.vectors());
    std::copy(found.strength.begin(), found.strength.end(), strength.values());
    Flags cut(n);
    std::copy(found.cut.get(), found.cut.get() + n, cut.values());
    return nb::make_tuple(points.array(), strength.array(), cut.array(), found.inside, found.outside);
}

nb::tuple py_outline_support(const ByteImage &image, const RowArray &H, const PointArray &points,
                             const PointArray &normals, const ValueArray &strength, const PointArray &contacts,
                             int polarity, double area, double reach_share, double least_reach, double most_reach,
                             double least_strength, double relative_strength, double other_ground, double loose) {
    const std::size_t m = points.shape(0), k = contacts.shape(0);
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    if (m == 0 || k == 0 || normals.shape(0) != m || strength.shape(0) != m)
        throw std::invalid_argument("samples, each with its normal and strength, and contacts are needed");
    Output at(m, 2), along(m, 2), edges(m, 4), shift(k, 2), covariance(k, 4);
    Flags inside(m), found(m);
    std::fill(edges.values(), edges.values() + 4 * m, 0.0);
    std::fill(shift.values(), shift.values() + 2 * k, 0.0);
    std::fill(covariance.values(), covariance.values() + 4 * k, 0.0);
    const SupportValues values = outline_support(
        seen(image), H.data(), points.data(), normals.data(), strength.data(), m, contacts.data(), k,
        {area, reach_share, least_reach, most_reach, least_strength, relative_strength, other_ground, loose, polarity},
        {at.vectors(), along.vectors(), reinterpret_cast<Edge *>(edges.values()), inside.values(), found.values()},
        shift.values(), covariance.values());
    return nb::make_tuple(values.size, values.reach, at.array(), along.array(), edges.array(), inside.array(),
                          found.array(), shift.array(), covariance.array().attr("reshape")(nb::make_tuple(k, 2, 2)));
}

nb::tuple py_register_outline(const ByteImage &image, const RowArray &H, const PointArray &points,
                              const PointArray &normals, const ValueArray &strength, int polarity,
                              const ValueArray &reaches, const IndexArray &motions, const IndexArray &strides,
                              double least_strength, double relative_strength,
                              const std::optional<ByteImage> &clear) {
    const std::size_t m = points.shape(0), steps = reaches.shape(0);
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    if (m == 0 || normals.shape(0) != m || strength.shape(0) != m)
        throw std::invalid_argument("samples are needed, each with its normal and strength");
    if (steps == 0 || motions.shape(0) != steps || strides.shape(0) != steps)
        throw std::invalid_argument("each step needs its reach, motion and stride");
    for (std::size_t i = 0; i < steps; ++i) {
        const std::int64_t motion = motions.data()[i];
        if (!(reaches.data()[i] > 0 && reaches.data()[i] <= 1000))
            throw std::invalid_argument("reach must be above 0 and at most 1000 px, not " + number(reaches.data()[i]));
        if (motion != 4 && motion != 6 && motion != 8)
            throw std::invalid_argument("a motion has 4, 6 or 8 parameters, not " + std::to_string(motion));
        if (strides.data()[i] < 1)
            throw std::invalid_argument("a stride is 1 or more, not " + std::to_string(strides.data()[i]));
    }
    const Clear hidden = clear_of(image, clear);
    Output left(m), weight(m), found(3, 3);
    const Registered out = register_outline(seen(image), H.data(), points.data(), normals.data(), strength.data(), m,
                                            reaches.data(), motions.data(), strides.data(), steps,
                                            {polarity, least_strength, relative_strength},
                                            hidden, left.values(), weight.values());
    std::copy(out.H, out.H + 9, found.values());
    return nb::make_tuple(found.array(), left.array(), weight.array(), out.noise);
}

}  // namespace

void bind_images(nb::module_ &m) {
    m.def("carry_normals", &py_carry_normals, "H"_a, "points"_a, "normals"_a);
    m.def("edge_search", &py_edge_search<std::uint8_t>, "image"_a.noconvert(), "points"_a, "normals"_a, "reach"_a,
          "polarity"_a);
    m.def("edge_search", &py_edge_search<float>, "image"_a.noconvert(), "points"_a, "normals"_a, "reach"_a,
          "polarity"_a);
    m.def("projective_step", &py_projective_step, "points"_a, "normals"_a, "offsets"_a, "contacts"_a, "radius"_a,
          "loose"_a);
    m.def("settle_edges", &py_settle_edges, "points"_a, "normals"_a, "edges"_a, "fixed"_a, "fallback"_a, "outlier"_a);
    m.def("soft_threshold", &py_soft_threshold, "image"_a.noconvert(), "left"_a, "top"_a, "right"_a, "bottom"_a,
          "level"_a, "polarity"_a);
    m.def("trace_edges", &py_trace_edges, "image"_a.noconvert(), "chain"_a, "hidden"_a.none(), "hole"_a, "polarity"_a,
          "spacing"_a, "most"_a, "smoothing"_a, "reach"_a, "border"_a, "outlier"_a);
    m.def("outline_support", &py_outline_support, "image"_a.noconvert(), "H"_a, "points"_a, "normals"_a, "strength"_a,
          "contacts"_a, "polarity"_a, "area"_a, "reach_share"_a, "least_reach"_a, "most_reach"_a, "least_strength"_a,
          "relative_strength"_a, "other_ground"_a, "loose"_a);
    m.def("register_outline", &py_register_outline, "image"_a.noconvert(), "H"_a, "points"_a, "normals"_a, "strength"_a,
          "polarity"_a, "reaches"_a, "motions"_a, "strides"_a, "least_strength"_a, "relative_strength"_a,
          "clear"_a.none() = nb::none());
    m.def("edge_links", &py_edge_links, "edges"_a.noconvert(), "reach"_a, "bend"_a, "loose"_a);
}

}  // namespace grasptrack
