#!/bin/sh
PYTHONPATH=/usr/lib/crux/python${PYTHONPATH:+:$PYTHONPATH} exec /usr/bin/python3 -P -m crux_tools.cli "$@"
