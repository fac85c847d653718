// SPDX-License-Identifier: Apache-2.0
//
// Errors that all images of a camera share and that its calibration does not estimate: their part
// of the standard errors.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>

#include "calib/adjust/bundle.h"
#include "calib/noise/uncertainty.h"
#include "calib/start/input.h"

namespace plenocal {

/// Displacements of an observation's measured coordinates by some errors, px for one standard
/// deviation, a column each. `J`: derivatives of the predicted coordinates by
/// `BundleCamera::params`.
using ErrorColumns =
    std::function<Eigen::MatrixXd(const Observation& seen, const Eigen::MatrixXd& J)>;

/// The bundle with `count` more shared errors of a camera as unknowns; where the model is not
/// defined, they displace nothing.
Bundle WithSharedErrors(Bundle bundle,
                        size_t camera,
                        Eigen::Index count,
                        const ErrorColumns& columns);

/// Adds the errors of the cameras' micro-image centres, where they are known, to an uncertainty: G
/// G', G the change of the estimate with independent errors of unit variance. The estimate itself
/// does not depend on them. `inputs`: of the bundle's cameras.
void AddLatticeErrors(std::span<const CameraInput> inputs,
                      const Bundle& bundle,
                      Uncertainty* uncertainty);

}  // namespace plenocal
