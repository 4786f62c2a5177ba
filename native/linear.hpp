// SPDX-License-Identifier: Apache-2.0
// Linear equations of any size, by elimination with row exchanges.
#pragma once

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <utility>
#include <vector>

namespace grasptrack {

// A = P L U of a square matrix, row after row.
class Factors {
  public:
    Factors(std::vector<double> A, std::size_t size) : n_(size), lu_(std::move(A)), row_(size) {
        for (std::size_t i = 0; i < n_; ++i) row_[i] = i;
        for (std::size_t k = 0; k < n_; ++k) {
            std::size_t best = k;
            for (std::size_t i = k + 1; i < n_; ++i)
                if (std::abs(lu_[i * n_ + k]) > std::abs(lu_[best * n_ + k])) best = i;
            if (lu_[best * n_ + k] == 0.0) throw std::invalid_argument("Singular matrix");
            if (best != k) {
                for (std::size_t j = 0; j < n_; ++j) std::swap(lu_[k * n_ + j], lu_[best * n_ + j]);
                std::swap(row_[k], row_[best]);
            }
            const double *top = &lu_[k * n_];
            for (std::size_t i = k + 1; i < n_; ++i) {
                double *row = &lu_[i * n_];
                const double share = row[k] /= top[k];
                for (std::size_t j = k + 1; j < n_; ++j) row[j] -= share * top[j];
            }
        }
    }

    // x with A x = b.
    void solve(const double *b, double *x) const {
        for (std::size_t i = 0; i < n_; ++i) {
            double sum = b[row_[i]];
            for (std::size_t j = 0; j < i; ++j) sum -= lu_[i * n_ + j] * x[j];
            x[i] = sum;
        }
        for (std::size_t i = n_; i-- > 0;) {
            for (std::size_t j = i + 1; j < n_; ++j) x[i] -= lu_[i * n_ + j] * x[j];
            x[i] /= lu_[i * n_ + i];
        }
    }

    // A^-1, row after row.
    void inverse(double *out) const {
        std::vector<double> unit(n_), column(n_);
        for (std::size_t j = 0; j < n_; ++j) {
            unit[j] = 1.0;
            solve(unit.data(), column.data());
            unit[j] = 0.0;
            for (std::size_t i = 0; i < n_; ++i) out[i * n_ + j] = column[i];
        }
    }

  private:
    std::size_t n_;
    std::vector<double> lu_;
    std::vector<std::size_t> row_;
};

}  // namespace grasptrack
