/// Vectors and rotations of the planner's compiled parts.
#ifndef CRUX_PLANNER_VECTOR_HPP
#define CRUX_PLANNER_VECTOR_HPP

#include <array>

namespace crux {

template <class T>
using Vec = std::array<T, 3>;
using Vector = Vec<double>;
using Matrix = std::array<Vector, 3>;  ///< columns

template <class T>
inline Vec<T> operator+(const Vec<T>& a, const Vec<T>& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
template <class T>
inline Vec<T> operator-(const Vec<T>& a, const Vec<T>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
template <class S, class T>
inline Vec<T> operator*(const S& s, const Vec<T>& a) {
  return {s * a[0], s * a[1], s * a[2]};
}
template <class T>
inline T dot(const Vec<T>& a, const Vec<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

template <class T>
inline Vec<T> cross(const Vec<T>& a, const Vec<T>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Vector operator*(const Matrix& m, const Vector& v) { return v[0] * m[0] + (v[1] * m[1] + v[2] * m[2]); }

inline Vector vector(const double* v) { return {v[0], v[1], v[2]}; }

inline Matrix matrix(const double* rows) {
  return {Vector{rows[0], rows[3], rows[6]}, Vector{rows[1], rows[4], rows[7]}, Vector{rows[2], rows[5], rows[8]}};
}

}  // namespace crux

#endif
