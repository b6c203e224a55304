"""What each reader of somebody's files accepts, refuses and leaves out: tables that the tests go through."""
