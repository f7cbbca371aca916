"""An operator's commands, approvals of plans, and the replies to both."""
