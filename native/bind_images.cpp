// SPDX-License-Identifier: Apache-2.0
// The kernels of images in Python.

#include "bind_images.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <optional>
#include <limits>
#include <vector>

#include "arrays.hpp"
#include "edges.hpp"
#include "evidence.hpp"
#include "links.hpp"
#include "outline.hpp"
#include "threshold.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using ByteImage = nb::ndarray<const std::uint8_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using ChainArray = nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

Image<std::uint8_t> seen(const ByteImage &image) {
    return {image.data(), static_cast<std::ptrdiff_t>(image.shape(0)), static_cast<std::ptrdiff_t>(image.shape(1))};
}

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

nb::object py_blur_threshold(const ByteImage &image,
                             std::int64_t left, std::int64_t top, std::int64_t right, std::int64_t bottom, double level,
                             int polarity) {
    const auto height = static_cast<std::int64_t>(image.shape(0)), width = static_cast<std::int64_t>(image.shape(1));
    if (!(0 <= left && left < right && right <= width && 0 <= top && top < bottom && bottom <= height))
        throw std::invalid_argument("the window must lie in the image and hold a pixel");
    const std::size_t rows = static_cast<std::size_t>(bottom - top), columns = static_cast<std::size_t>(right - left);
    auto *data = new std::uint8_t[rows * columns];
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<std::uint8_t *>(p); });
    blur_threshold(image.data(), height, width, left, top, right, bottom, level, polarity, data);
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

}  // namespace

void bind_images(nb::module_ &m) {
    m.def("carry_normals", &py_carry_normals, "H"_a, "points"_a, "normals"_a);
    m.def("edge_search", &py_edge_search<std::uint8_t>, "image"_a.noconvert(), "points"_a, "normals"_a, "reach"_a,
          "polarity"_a);
    m.def("edge_search", &py_edge_search<float>, "image"_a.noconvert(), "points"_a, "normals"_a, "reach"_a,
          "polarity"_a);
    m.def("settle_edges", &py_settle_edges, "points"_a, "normals"_a, "edges"_a, "fixed"_a, "fallback"_a, "outlier"_a);
    m.def("blur_threshold", &py_blur_threshold, "image"_a.noconvert(), "left"_a, "top"_a, "right"_a, "bottom"_a,
          "level"_a, "polarity"_a);
    m.def("trace_edges", &py_trace_edges, "image"_a.noconvert(), "chain"_a, "hidden"_a.none(), "hole"_a, "polarity"_a,
          "spacing"_a, "most"_a, "smoothing"_a, "reach"_a, "border"_a, "outlier"_a);
    m.def("edge_links", &py_edge_links, "edges"_a.noconvert(), "reach"_a, "bend"_a, "loose"_a);
}

}  // namespace grasptrack
