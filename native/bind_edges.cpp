// SPDX-License-Identifier: Apache-2.0
// The kernels of broken edges in Python.

#include "bind_edges.hpp"

#include <nanobind/ndarray.h>

#include <algorithm>

#include "arrays.hpp"
#include "links.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using EdgeImage = nb::ndarray<const std::uint8_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

nb::object py_edge_links(const EdgeImage &edges, double reach, double bend, double loose) {
    const auto links = edge_links(edges.data(), static_cast<std::int64_t>(edges.shape(0)),
                                  static_cast<std::int64_t>(edges.shape(1)), reach, bend, loose);
    OutputOf<std::int64_t> out(links.size(), 4);
    for (std::size_t i = 0; i < links.size(); ++i) std::copy(links[i].begin(), links[i].end(), out.values() + 4 * i);
    return out.array();
}

}  // namespace

void bind_edges(nb::module_ &m) {
    m.def("edge_links", &py_edge_links, "edges"_a.noconvert(), "reach"_a, "bend"_a, "loose"_a);
}

}  // namespace grasptrack
