"""Numbers to bits and back: symbols, their tables, and quantiser steps."""
