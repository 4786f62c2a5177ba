// SPDX-License-Identifier: Apache-2.0
// Small dense matrices of fixed size: what Gauss-Newton on a pose needs, and no more.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <vector>

#include "../wide.hpp"

namespace grasptrack::pose {

// The value of rank n / 2 of at least one; NaN, which `<` does not order, counts as the largest. Reorders them.
inline double middle(std::vector<double> &values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    if (std::any_of(values.begin(), values.end(), [](double a) { return a != a; }))
        std::nth_element(values.begin(), at, values.end(), [](double a, double b) { return a < b || (b != b && a == a); });
    else
        std::nth_element(values.begin(), at, values.end());
    return *at;
}

// A number without its fraction, within bounds; the lower one where it is none.
inline int whole(double value, int low, int high) {
    if (value != value) return low;
    return static_cast<int>(std::clamp(value, static_cast<double>(low), static_cast<double>(high)));
}

template <std::size_t N> using Vector = std::array<double, N>;
template <std::size_t N> using Matrix = std::array<double, N * N>;  // row by row
using Homography = Matrix<3>;

template <std::size_t N> Matrix<N> diagonal(double value) {
    Matrix<N> out{};
    for (std::size_t i = 0; i < N; ++i) out[i * N + i] = value;
    return out;
}

template <std::size_t N> Vector<N> times(const Matrix<N> &a, const Vector<N> &x) {
    Vector<N> out{};
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) out[i] += a[i * N + j] * x[j];
    return out;
}

template <std::size_t N> Matrix<N> times(const Matrix<N> &a, const Matrix<N> &b) {
    Matrix<N> out{};
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t k = 0; k < N; ++k)
            for (std::size_t j = 0; j < N; ++j) out[i * N + j] += a[i * N + k] * b[k * N + j];
    return out;
}

template <std::size_t N> Matrix<N> transposed(const Matrix<N> &a) {
    Matrix<N> out;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) out[i * N + j] = a[j * N + i];
    return out;
}

template <std::size_t N> double quadratic(const Matrix<N> &a, const double *x) {
    double sum = 0.0;
    for (std::size_t i = 0; i < N; ++i) {
        double row = 0.0;
        for (std::size_t j = 0; j < N; ++j) row += a[i * N + j] * x[j];
        sum += row * x[i];
    }
    return sum;
}

// A symmetric matrix by its entries on and above the diagonal, row by row: loops over all of them are straight.
template <std::size_t N> using Packed = std::array<double, N *(N + 1) / 2>;

// x x^T
template <std::size_t N> Packed<N> outer(const Vector<N> &x) {
    Packed<N> out;
    std::size_t at = 0;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = i; j < N; ++j) out[at++] = x[i] * x[j];
    return out;
}

template <std::size_t N> Matrix<N> unpacked(const Packed<N> &a) {
    Matrix<N> out;
    std::size_t at = 0;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = i; j < N; ++j) out[i * N + j] = out[j * N + i] = a[at++];
    return out;
}

// Sum of N products, in parts that do not wait for each other.
template <std::size_t N> GRASPTRACK_WITHIN double sum_of_products(const double *a, const double *b) {
    constexpr std::size_t parts = 4, even = N / parts * parts;
    double sum[parts] = {};
    for (std::size_t k = 0; k < even; k += parts)
        for (std::size_t p = 0; p < parts; ++p) sum[p] += a[k + p] * b[k + p];
    for (std::size_t k = even; k < N; ++k) sum[0] += a[k] * b[k];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

// A matrix whose quadratic form is asked for often, of vectors whose outer products are known.
template <std::size_t N> class Form {
  public:
    explicit Form(const Matrix<N> &a) {
        std::size_t at = 0;
        for (std::size_t i = 0; i < N; ++i)
            for (std::size_t j = i; j < N; ++j) packed_[at++] = j == i ? a[i * N + i] : a[i * N + j] + a[j * N + i];
    }
    GRASPTRACK_WITHIN double operator()(const Packed<N> &outer) const {
        return sum_of_products<N *(N + 1) / 2>(packed_.data(), outer.data());
    }

  private:
    Packed<N> packed_;
};

// The lower triangle L with L L^T = a, of a symmetric positive definite matrix, and its inverse; false where it is not one.
template <std::size_t N> bool cholesky(const Matrix<N> &a, Matrix<N> &lower, Matrix<N> &inverse) {
    lower = inverse = {};
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j <= i; ++j) {
            double sum = a[i * N + j];
            for (std::size_t k = 0; k < j; ++k) sum -= lower[i * N + k] * lower[j * N + k];
            if (i == j) {
                if (!(sum > 0.0) || !std::isfinite(sum)) return false;
                lower[i * N + i] = std::sqrt(sum);
            } else {
                lower[i * N + j] = sum / lower[j * N + j];
            }
        }
    for (std::size_t i = 0; i < N; ++i) {
        inverse[i * N + i] = 1.0 / lower[i * N + i];
        for (std::size_t j = 0; j < i; ++j) {
            double sum = 0.0;
            for (std::size_t k = j; k < i; ++k) sum -= lower[i * N + k] * inverse[k * N + j];
            inverse[i * N + j] = sum / lower[i * N + i];
        }
    }
    return true;
}

// The inverse of a symmetric positive definite matrix; false where it is not one.
template <std::size_t N> bool invert(const Matrix<N> &a, Matrix<N> &out) {
    Matrix<N> lower, inverse;
    if (!cholesky<N>(a, lower, inverse)) return false;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j <= i; ++j) {
            double sum = 0.0;
            for (std::size_t k = i; k < N; ++k) sum += inverse[k * N + i] * inverse[k * N + j];
            out[i * N + j] = out[j * N + i] = sum;
        }
    return true;
}

// Normal equations of the leading M unknowns of N, the others eliminated: whatever these may be is allowed for.
template <std::size_t M, std::size_t N> void reduce(Matrix<N> a, Vector<N> b, Matrix<M> &lead, Vector<M> &right) {
    for (std::size_t k = N; k-- > M;)
        for (std::size_t i = 0; i < k; ++i) {
            const double share = a[i * N + k] / a[k * N + k];
            b[i] -= share * b[k];
            for (std::size_t j = 0; j < k; ++j) a[i * N + j] -= share * a[k * N + j];
        }
    for (std::size_t i = 0; i < M; ++i) {
        right[i] = b[i];
        for (std::size_t j = 0; j < M; ++j) lead[i * M + j] = a[i * N + j];
    }
}

// Normal equations of the leading M unknowns of N, added to those of all.
template <std::size_t M, std::size_t N> void add_rows(Matrix<N> &a, Vector<N> &b, const Matrix<M> &more, const Vector<M> &right) {
    for (std::size_t i = 0; i < M; ++i) {
        b[i] += right[i];
        for (std::size_t j = 0; j < M; ++j) a[i * N + j] += more[i * M + j];
    }
}

// The block of rows and columns from `first` on.
template <std::size_t N, std::size_t M> Matrix<M> block(const Matrix<N> &a, std::size_t first) {
    Matrix<M> out;
    for (std::size_t i = 0; i < M; ++i)
        for (std::size_t j = 0; j < M; ++j) out[i * M + j] = a[(first + i) * N + first + j];
    return out;
}

inline bool invert_homography(const Homography &h, Homography &out) {
    const double a = h[4] * h[8] - h[5] * h[7], b = h[5] * h[6] - h[3] * h[8], c = h[3] * h[7] - h[4] * h[6];
    const double det = h[0] * a + h[1] * b + h[2] * c;
    if (!(std::abs(det) > 1e-300) || !std::isfinite(det)) return false;
    const double s = 1.0 / det;
    out = {a * s, (h[2] * h[7] - h[1] * h[8]) * s, (h[1] * h[5] - h[2] * h[4]) * s,
           b * s, (h[0] * h[8] - h[2] * h[6]) * s, (h[2] * h[3] - h[0] * h[5]) * s,
           c * s, (h[1] * h[6] - h[0] * h[7]) * s, (h[0] * h[4] - h[1] * h[3]) * s};
    return true;
}

struct Point {
    double x, y;
};

// Eq. (2).
inline Point carried(const Homography &h, double x, double y) {
    const double w = 1.0 / (h[6] * x + h[7] * y + h[8]);
    return {(h[0] * x + h[1] * y + h[2]) * w, (h[3] * x + h[4] * y + h[5]) * w};
}

// The four derivatives of eq. (2) at a point: dx'/dx, dx'/dy, dy'/dx, dy'/dy.
inline std::array<double, 4> derivatives(const Homography &h, double x, double y) {
    const double w = 1.0 / (h[6] * x + h[7] * y + h[8]);
    const double u = (h[0] * x + h[1] * y + h[2]) * w, v = (h[3] * x + h[4] * y + h[5]) * w;
    return {(h[0] - h[6] * u) * w, (h[1] - h[7] * u) * w, (h[3] - h[6] * v) * w, (h[4] - h[7] * v) * w};
}

}  // namespace grasptrack::pose
