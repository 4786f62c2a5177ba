// SPDX-License-Identifier: Apache-2.0
// Edges of images, and thresholds, in Python.

#include <nanobind/stl/tuple.h>

#include "../arrays.hpp"
#include "edges.hpp"
#include "links.hpp"
#include "outline.hpp"
#include "threshold.hpp"

namespace grasptrack {

namespace {

template <typename Pixel> Image<Pixel> image_of(const Input<Pixel, nb::ndim<2>> &image) {
    return {image.data(), static_cast<std::ptrdiff_t>(image.shape(0)), static_cast<std::ptrdiff_t>(image.shape(1))};
}

int sign_of(std::int64_t polarity) { return (polarity > 0) - (polarity < 0); }

template <typename Pixel>
nb::object search_along_normals_(const Input<Pixel, nb::ndim<2>> &image, const PointArray &points, const PointArray &normals,
                                 double reach, std::int64_t polarity) {
    if (!(reach > 0 && reach <= 1000))
        throw std::invalid_argument("reach must be above 0 and at most 1000 px, not " + number(reach));
    const Points at = points_of(points);
    if (normals.shape(0) != at.size)
        throw std::invalid_argument(std::to_string(at.size) + " points but " + std::to_string(normals.shape(0)) + " normals");
    static_assert(sizeof(Edge) == 4 * sizeof(double));
    Output<> out(at.size, 4);
    search_along_normals(image_of<Pixel>(image), at, vectors(normals), reach, sign_of(polarity), reinterpret_cast<Edge *>(out.values()));
    return out.array();
}

// Of grasptrack.kernels.results.TraceOptions.
using TraceOptions = std::tuple<bool, std::int64_t, double, std::int64_t, double, double, double, double>;

nb::object trace_edges_(const ByteImage &image, const Input<std::int32_t, nb::shape<-1, 2>> &chain,
                        const std::optional<ByteImage> &hidden, const TraceOptions &options) {
    static const Record record("TracedEdges");
    const auto [hole, polarity, spacing, most, smoothing, reach, border, outlier] = options;
    if (chain.shape(0) < 3) throw std::invalid_argument("a chain has at least 3 pixels");
    if (hidden && (hidden->shape(0) != image.shape(0) || hidden->shape(1) != image.shape(1)))
        throw std::invalid_argument("what is hidden needs the image's size");
    if (image.size() == 0) throw std::invalid_argument("an image has pixels");
    if (!(spacing > 0) || most < 16 || most > 65536 || !(reach > 0 && reach <= 1000) || !(smoothing >= 0))
        throw std::invalid_argument("spacing must be above 0, reach too and at most 1000 px, points 16 to 65536, smoothing at least 0");
    const Traced found = trace_edges(image_of<std::uint8_t>(image), chain.data(), chain.shape(0), hidden ? hidden->data() : nullptr,
                                     {spacing, static_cast<double>(most), smoothing, reach, border, outlier, hole, sign_of(polarity)});
    const std::size_t n = found.points.size();
    return record(copied(&found.points[0].x, n, 2), copied(found.strength), copied(found.cut.get(), n), found.inside,
                  found.outside);
}

}  // namespace

void bind_image(nb::module_ &m) {
    m.attr("EDGE_WINDOW") = window;
    m.def("search_along_normals", &search_along_normals_<std::uint8_t>, "image"_a.noconvert(), "points"_a, "normals"_a,
          "reach"_a, "polarity"_a);
    m.def("search_along_normals", &search_along_normals_<float>, "image"_a.noconvert(), "points"_a, "normals"_a, "reach"_a,
          "polarity"_a);
    m.def("trace_edges", &trace_edges_, "image"_a.noconvert(), "chain"_a, "hidden"_a.none(), "options"_a);
    m.def("blur_threshold", [](const ByteImage &image, std::int64_t left, std::int64_t top, std::int64_t right,
                               std::int64_t bottom, double level, std::int64_t polarity) {
        const auto height = static_cast<std::int64_t>(image.shape(0)), width = static_cast<std::int64_t>(image.shape(1));
        if (!(0 <= left && left < right && right <= width && 0 <= top && top < bottom && bottom <= height))
            throw std::invalid_argument("the window must lie in the image and hold a pixel");
        if (std::isnan(level)) throw std::invalid_argument("the level must be a number");
        Output<std::uint8_t> out(bottom - top, right - left);
        blur_threshold(image.data(), height, width, left, top, right, bottom, level, sign_of(polarity), out.values());
        return out.array();
    }, "image"_a.noconvert(), "left"_a, "top"_a, "right"_a, "bottom"_a, "level"_a, "polarity"_a);
    m.def("edge_links", [](const ByteImage &edges, double reach, double bend, double loose) {
        if (std::isnan(reach) || std::isnan(bend) || std::isnan(loose)) throw std::invalid_argument("reach, bend and loose must be numbers");
        const auto links = edge_links(edges.data(), static_cast<std::int64_t>(edges.shape(0)),
                                      static_cast<std::int64_t>(edges.shape(1)), reach, bend, loose);
        Output<std::int64_t> out(links.size(), 4);
        for (std::size_t i = 0; i < links.size(); ++i) std::copy(links[i].begin(), links[i].end(), out.values() + 4 * i);
        return out.array();
    }, "edges"_a.noconvert(), "reach"_a, "bend"_a, "loose"_a);
}

}  // namespace grasptrack
