/// Vectors and rotations of the planner's compiled parts.
#ifndef CRUX_PLANNER_VECTOR_HPP
#define CRUX_PLANNER_VECTOR_HPP

#include <array>

namespace crux {

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;  ///< columns

inline Vector operator+(const Vector& a, const Vector& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vector operator-(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vector operator*(double s, const Vector& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Vector operator*(const Matrix& m, const Vector& v) { return v[0] * m[0] + (v[1] * m[1] + v[2] * m[2]); }

inline Vector vector(const double* v) { return {v[0], v[1], v[2]}; }

inline Matrix matrix(const double* rows) {
  return {Vector{rows[0], rows[3], rows[6]}, Vector{rows[1], rows[4], rows[7]}, Vector{rows[2], rows[5], rows[8]}};
}

}  // namespace crux

#endif
