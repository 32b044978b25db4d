#pragma once

#include "absl/status/status.h"

namespace tessera::agent {

/// Gives up, for this process and for good, what rendering does not take: new sockets, other
/// programs, other processes, and writing to any file that is not open yet. A scene that takes over
/// its parser can then reach neither the network nor the disk. What is refused fails with EPERM.
///
/// Reading files stays allowed (libraries are loaded late), as does all that is done with open
/// descriptors. Call it while the process has one thread. Errors: Unavailable, this kernel has no
/// seccomp filters; nothing is given up then.
absl::Status enter_sandbox();

}  // namespace tessera::agent
