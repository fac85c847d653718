// SPDX-License-Identifier: Apache-2.0
//
// The program as a function, for main() and the Python module.
#pragma once

namespace plenocal {

/// Runs `plenocal` with these arguments, with messages, Ctrl-C and standard streams as a program
/// has them; returns its exit status.
int RunProgram(int argc, char** argv);

/// Ceres warns of every step that it has to repeat; how a solver ended is in its summary.
void SilenceSolver();

}  // namespace plenocal
