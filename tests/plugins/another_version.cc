// SPDX-License-Identifier: Apache-2.0
//
// What a plug-in of another version looks like: its table must not be touched.
extern "C" {
extern const char plenocal_plugin_abi[];
extern const char plenocal_plugin_models[];
}
const char plenocal_plugin_abi[] = "plenocal 0.0.1, interface 01234567";
const char plenocal_plugin_models[] = "no table";
