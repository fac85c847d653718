// SPDX-License-Identifier: Apache-2.0
//
// Models with the mistakes that `plenocal models check` is for.
#include "models/plugin/plugin.h"
#include "models/start/central_model.h"

namespace {

using plenocal::LensModel;
using plenocal::Vector3;

// A pinhole whose inverse forgets the sign of y.
struct WrongInverse : LensModel<WrongInverse> {
  static constexpr std::string_view kName = "wrong-inverse";
  static constexpr std::string_view kSource = "tests/plugins";
  static constexpr auto kParams = plenocal::WithIntrinsics<0>({});
  static constexpr std::array kExample{500.0, 502.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T*, const Vector3<T>& p, T* m) {
    if (!(p.z() > 0.0)) return false;
    m[0] = p.x() / p.z();
    m[1] = p.y() / p.z();
    return true;
  }
  static std::optional<Eigen::Vector3d> Unmap(const double*, const Eigen::Vector2d& m) {
    return Eigen::Vector3d(m.x(), std::abs(m.y()), 1);
  }
};

// Division by the depth's value alone, which loses its derivative.
struct WrongDerivative : LensModel<WrongDerivative> {
  static constexpr std::string_view kName = "wrong-derivative";
  static constexpr std::string_view kSource = "tests/plugins";
  static constexpr auto kParams = plenocal::WithIntrinsics<0>({});
  static constexpr std::array kExample{500.0, 502.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T*, const Vector3<T>& p, T* m) {
    const double z = plenocal::ValueOf(p.z());
    if (!(z > 0)) return false;
    m[0] = p.x() / z;
    m[1] = p.y() / z;
    return true;
  }
  static std::optional<Eigen::Vector3d> Unmap(const double*, const Eigen::Vector2d& m) {
    return Eigen::Vector3d(m.x(), m.y(), 1);
  }
};

}  // namespace

PLENOCAL_CAMERA_MODEL_PLUGIN(WrongInverse, WrongDerivative)
