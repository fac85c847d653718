// SPDX-License-Identifier: Apache-2.0
//
// The families of AprilTags and the dictionaries of ArUco markers that targets may have.
#pragma once

#include <array>
#include <string_view>

namespace plenocal::internal {

/// A set of printed codes and how many it has.
struct CodeBook {
  std::string_view name;
  int size;
};

/// AprilTag families; sizes as `apriltag_family_t::ncodes`.
inline constexpr std::array kTagFamilies = {CodeBook{"tag16h5", 30},
                                            CodeBook{"tag25h9", 35},
                                            CodeBook{"tag36h10", 2320},
                                            CodeBook{"tag36h11", 587},
                                            CodeBook{"tagCircle21h7", 38},
                                            CodeBook{"tagCircle49h12", 65535},
                                            CodeBook{"tagCustom48h12", 42211},
                                            CodeBook{"tagStandard41h12", 2115},
                                            CodeBook{"tagStandard52h13", 48714}};

/// Of a tag grid that names none, as of Kalibr's.
inline constexpr CodeBook kDefaultFamily = kTagFamilies[3];
static_assert(kDefaultFamily.name == "tag36h11");

/// OpenCV's predefined dictionaries of ArUco markers, in the order of OpenCV's enumeration.
inline constexpr std::array kArucoDictionaries = {
    CodeBook{"DICT_4X4_50", 50},           CodeBook{"DICT_4X4_100", 100},
    CodeBook{"DICT_4X4_250", 250},         CodeBook{"DICT_4X4_1000", 1000},
    CodeBook{"DICT_5X5_50", 50},           CodeBook{"DICT_5X5_100", 100},
    CodeBook{"DICT_5X5_250", 250},         CodeBook{"DICT_5X5_1000", 1000},
    CodeBook{"DICT_6X6_50", 50},           CodeBook{"DICT_6X6_100", 100},
    CodeBook{"DICT_6X6_250", 250},         CodeBook{"DICT_6X6_1000", 1000},
    CodeBook{"DICT_7X7_50", 50},           CodeBook{"DICT_7X7_100", 100},
    CodeBook{"DICT_7X7_250", 250},         CodeBook{"DICT_7X7_1000", 1000},
    CodeBook{"DICT_ARUCO_ORIGINAL", 1024}, CodeBook{"DICT_APRILTAG_16h5", 30},
    CodeBook{"DICT_APRILTAG_25h9", 35},    CodeBook{"DICT_APRILTAG_36h10", 2320},
    CodeBook{"DICT_APRILTAG_36h11", 587}};

}  // namespace plenocal::internal
