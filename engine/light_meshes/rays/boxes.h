/* Trees of boxes (boxes.py). */
#pragma once
#include "native.h"

enum { LEAF = 4, BINS = 16, STACK = 128 };
