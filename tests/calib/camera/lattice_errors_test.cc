// SPDX-License-Identifier: Apache-2.0
//
// Errors of fitted lattices against Monte Carlo, and their file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <map>

#include "calib/base/linear_algebra.h"
#include "calib/camera/lens_lattice.h"
#include "calib/camera/micro_lens_array.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using testing::Random;

constexpr ImageSize kSize{820, 780};
constexpr double kNoise = 0.004;  // px
constexpr int kTrials = 40;

// A hexagonal lattice of pitch 20 px, bent by some pixels.
Eigen::Vector2d Place(const LatticeNode& node) {
  const Eigen::Vector2d s((node.column + node.row / 2.0) / 20, node.row / 20.0 * 0.866);
  const Eigen::Vector2d bent = s * (1 + 0.01 * s.squaredNorm() * (1 + s.squaredNorm()));
  return Eigen::Vector2d(409.5, 389.5) + 400 * bent;
}

// The nodes on the sensor, those with x < `right` only.
std::vector<LatticeMeasurement> Lattice(double right = kSize[0]) {
  std::vector<LatticeMeasurement> nodes;
  for (int row = -30; row <= 30; ++row) {
    for (int column = -50; column <= 50; ++column) {
      const LatticeNode node{column, row};
      const Eigen::Vector2d place = Place(node);
      if (IsInside(place, kSize) && place.x() < right) {
        nodes.push_back({.node = node, .position = place});
      }
    }
  }
  return nodes;
}

// Mean over trials of (error / sigma)^2 of the polynomial's coefficients together, over their
// number. `noise`: adds the errors of a trial.
double MeanSquare(const std::function<void(Random*, std::vector<LatticeMeasurement>*)>& noise) {
  const std::vector<LatticeMeasurement> exact = Lattice();
  Random random(5);
  double sum = 0, count = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<LatticeMeasurement> measured = exact;
    noise(&random, &measured);
    const SmoothLattice lattice = SmoothLattice::Fit(measured);
    const LatticeErrors errors = ErrorsOfFit(lattice, measured, kSize);
    const Eigen::MatrixXd root = errors.Root();
    Eigen::MatrixXd by_errors(std::ssize(exact), root.cols()), found(std::ssize(exact), 2);
    for (Eigen::Index i = 0; i < found.rows(); ++i) {
      const LatticeMeasurement& m = exact[static_cast<size_t>(i)];
      by_errors.row(i) = errors.Terms(m.position).transpose() * root;
      found.row(i) = lattice.Position(m.node.column, m.node.row) - m.position;
    }
    const Eigen::MatrixXd independent = LeastSquares(by_errors, found);
    sum += independent.squaredNorm();
    count += static_cast<double>(independent.size());
  }
  return sum / count;
}

TEST(LatticeErrors, AgreeWithMonteCarlo) {
  const double mean = MeanSquare([](Random* random, std::vector<LatticeMeasurement>* measured) {
    for (LatticeMeasurement& m : *measured) m.position += random->Gaussians<2>(kNoise);
  });
  // 99 % of the means of 40 times 42 numbers.
  EXPECT_GT(mean, 0.91);
  EXPECT_LT(mean, 1.09);
}

TEST(LatticeErrors, CountUncertainMeasurementsLess) {
  const double mean = MeanSquare([](Random* random, std::vector<LatticeMeasurement>* measured) {
    for (LatticeMeasurement& m : *measured) {
      m.sigma = (m.node.column + m.node.row) % 2 == 0 ? 1 : 5;
      m.position += random->Gaussians<2>(m.sigma * kNoise);
    }
  });
  EXPECT_GT(mean, 0.91);
  EXPECT_LT(mean, 1.09);
}

TEST(LatticeErrors, ContainErrorsThatNeighboursShare) {
  const double mean = MeanSquare([](Random* random, std::vector<LatticeMeasurement>* measured) {
    std::map<std::array<int, 2>, Eigen::Vector2d> shared;
    for (LatticeMeasurement& m : *measured) {
      const std::array<int, 2> group{(m.node.column + 301) / 3, (m.node.row + 301) / 3};
      const auto [error, is_new] = shared.try_emplace(group);
      if (is_new) error->second = random->Gaussians<2>(kNoise);
      m.position += error->second + random->Gaussians<2>(kNoise / 10);
    }
  });
  EXPECT_GT(mean, 0.8);  // 9 by single nodes
  EXPECT_LT(mean, 1.8);
}

TEST(LatticeErrors, AreLargeWhereTheArrayIsDark) {
  std::vector<LatticeMeasurement> lit = Lattice(kSize[0] / 2.0);
  Random random(2);
  for (LatticeMeasurement& m : lit) m.position += random.Gaussians<2>(kNoise);
  const LatticeErrors errors = ErrorsOfFit(SmoothLattice::Fit(lit), lit, kSize);
  const auto sigma = [&](double x, double y) {
    return (errors.Terms({x, y}).transpose() * errors.Root()).norm();
  };
  EXPECT_LT(sigma(200, 390), kNoise);
  EXPECT_GT(sigma(800, 390), 20 * kNoise);
}

TEST(LatticeErrors, OfFewMicroLensesAreThoseOfANominalGrid) {
  std::vector<LatticeMeasurement> few = Lattice();
  few.resize(59);
  const LatticeErrors errors = ErrorsOfFit(SmoothLattice::Fit(few), few, kSize);
  EXPECT_EQ(errors.covariance, ErrorsOfNominalGrid(kSize).covariance);
  const Eigen::MatrixXd root = errors.Root();
  EXPECT_NEAR((errors.Terms({409.5, 389.5}).transpose() * root).norm(), 0.1, 1e-12);
}

class LatticeFile : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::string MessageOf(const std::string& content) const {
    Write("lattice.yaml", content);
    return testing::RefusalOf([&] { ReadLatticeErrors(path_, kSize); });
  }

  const std::filesystem::path path_ = Path("lattice.yaml");
};

TEST_F(LatticeFile, IsReadAsWritten) {
  std::vector<LatticeMeasurement> measured = Lattice();
  Random random(3);
  for (LatticeMeasurement& m : measured) m.position += random.Gaussians<2>(kNoise);
  const LatticeErrors written = ErrorsOfFit(SmoothLattice::Fit(measured), measured, kSize);
  ASSERT_EQ(MessageOf(FormatLatticeErrors(written)), "no refusal");
  const LatticeErrors read = ReadLatticeErrors(path_, kSize);
  EXPECT_EQ(read.image_size, written.image_size);
  EXPECT_TRUE(read.Covariance().isApprox(written.Covariance(), 1e-10));
  EXPECT_EQ(FormatLatticeErrors({}), "");
}

TEST_F(LatticeFile, SaysWhatIsWrong) {
  using ::testing::HasSubstr;
  const std::string head = "plenocal: 1\nimage_size: [820, 780]\n";
  EXPECT_EQ(MessageOf(head + "covariance: [[4e-6]]\n"), "no refusal");
  EXPECT_THAT(MessageOf(head), HasSubstr("covariance"));
  EXPECT_THAT(MessageOf("plenocal: 1\nimage_size: [820, 700]\ncovariance: [[4e-6]]\n"),
              HasSubstr("820 x 780 pixels: the lattice is of another array"));
  EXPECT_THAT(MessageOf(head + "covariance: [[1], [0, 1]]\n"), HasSubstr("lower triangle"));
  EXPECT_THAT(MessageOf(head + "covariance: []\n"), HasSubstr("lower triangle"));
  EXPECT_THAT(MessageOf(head + "covariance: [[1, 2]]\n"), HasSubstr("1 number"));
  EXPECT_THAT(MessageOf(head + "covariance: [[-1e-6]]\n"), HasSubstr("negative variance"));
  EXPECT_THAT(MessageOf(head + "covariance: [[1e300]]\n"), HasSubstr("as large as the image"));
  EXPECT_THAT(MessageOf(head + "covariance: [[.nan]]\n"), HasSubstr("number"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
