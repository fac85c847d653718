// SPDX-License-Identifier: Apache-2.0
//
// Target types of AprilTags: any arrangement, and grids.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "targets/target_type.h"

namespace plenocal {

/// Tags of the AprilTag library: a free arrangement in 3D (`apriltag`) or a regular grid
/// (`aprilgrid`). A tag's corners are the markers 4 * id + k, k counting lower left, lower right,
/// upper right, upper left of the upright tag, at the outer edge of its black border.
struct TagLayout {
  std::string family;                 ///< as the AprilTag library names it: "tag36h11"
  int border_bits = 1;                ///< width of the black border; Kalibr prints 2
  bool black_corner_squares = false;  ///< Kalibr's grids: black squares touch the tags' corners
  std::vector<int> ids;               ///< the tags that are on the target, ascending

  static Target ReadTags(const YamlNode& node);
  static constexpr std::array kTagsKeys{
      TargetKey{"family", "", "AprilTag family, such as tag36h11", ""},
      TargetKey{"border_bits", "bits", "width of the black border, 1 or 2", "1"},
      TargetKey{"tags", "", "list of the tags", ""},
      TargetKey{"tags.id", "", "the tag's number in its family", ""},
      TargetKey{"tags.corners",
                "m",
                "[x, y, z] of the lower left, lower right, upper right and upper left corner of "
                "the black border",
                ""}};
  static Target ReadGrid(const YamlNode& node);
  static constexpr std::array kGridKeys{
      TargetKey{"family", "", "AprilTag family, such as tag36h11", "tag36h11"},
      TargetKey{"columns", "", "tags in a row, 1 to 1000", ""},
      TargetKey{"rows", "", "tags in a column, 1 to 1000", ""},
      TargetKey{"size", "m", "side of a tag's black border", ""},
      TargetKey{"spacing", "", "gap between tags / size", ""},
      TargetKey{"border_bits",
                "bits",
                "width of the black border, 1 or 2; with 2, black squares touch the tags' corners",
                "2"},
      TargetKey{"first_id", "", "number of the lower left tag; ids go on row by row", "0"}};
  static constexpr std::array kTypes{
      TargetType{"apriltag",
                 kTagsKeys,
                 "family: tag36h11\ntags:\n"
                 "  - {id: 2, corners: [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]}\n"
                 "  - {id: 7, corners: [[1, 0, 0], [1.1, 0, 0], [1.1, 0, 0.1], [1, 0, 0.1]]}\n",
                 ReadTags},
      TargetType{"aprilgrid",
                 kGridKeys,
                 "columns: 3\nrows: 2\nsize: 0.08\nspacing: 0.25\n",
                 ReadGrid,
                 "size:spacing:family=tag36h11"}};

  static constexpr bool kHasNominalMarkers = true;
  [[nodiscard]] static int Part(int marker) { return marker / 4; }
  [[nodiscard]] static Eigen::Vector3d Normal(const MarkerPositions& markers, int marker);
  [[nodiscard]] std::vector<MarkerQuad> Quads() const;
  [[nodiscard]] TargetDoubts Doubts(const YamlNode& nominal) const;
  [[nodiscard]] std::vector<TargetPart> Draw(const MarkerPositions& markers, Pieces pieces) const;
};

}  // namespace plenocal
